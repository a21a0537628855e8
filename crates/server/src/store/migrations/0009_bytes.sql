-- How many bytes are stored, counted where they are written: of each job, of each payer, of all
-- scenes. Triggers keep the sums in the transactions that change them, so that nobody has to add
-- up all pictures to know.

ALTER TABLE jobs ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0; -- pictures, solution, baked light
ALTER TABLE jobs ADD COLUMN max_stored INTEGER;               -- the quota when it was accepted

CREATE TABLE payers (
    billed_to     TEXT PRIMARY KEY,              -- as jobs.billed_to
    bytes         INTEGER NOT NULL,              -- of all its jobs that are not deleted
    pinned_bytes  INTEGER NOT NULL               -- of those of them that are pinned
) STRICT, WITHOUT ROWID;
CREATE INDEX payers_by_bytes ON payers (bytes);

CREATE TABLE scene_bytes (
    id     INTEGER PRIMARY KEY CHECK (id = 1),
    bytes  INTEGER NOT NULL
) STRICT;

UPDATE jobs SET bytes =
      coalesce((SELECT sum(json_extract(record, '$.size')) FROM pictures WHERE job_id = jobs.id), 0)
    + coalesce((SELECT json_extract(record, '$.size') + coalesce(json_extract(record, '$.baked.size'), 0)
                FROM solutions WHERE job_id = jobs.id), 0);
INSERT INTO payers (billed_to, bytes, pinned_bytes)
    SELECT billed_to, sum(bytes), sum(iif(pinned, bytes, 0)) FROM jobs
    WHERE deleted_ms IS NULL GROUP BY billed_to;
INSERT INTO scene_bytes (id, bytes)
    SELECT 1, coalesce(sum(json_extract(record, '$.size')), 0) FROM scenes;

-- Jobs that can make room, by payer.
CREATE INDEX jobs_evictable ON jobs (billed_to, finished_ms, id)
    WHERE finished_ms IS NOT NULL AND pinned = 0 AND deleted_ms IS NULL AND bytes > 0;

CREATE TRIGGER scene_bytes_grow AFTER INSERT ON scenes
BEGIN
    UPDATE scene_bytes SET bytes = bytes + coalesce(json_extract(NEW.record, '$.size'), 0);
END;
CREATE TRIGGER scene_bytes_shrink AFTER DELETE ON scenes
BEGIN
    UPDATE scene_bytes SET bytes = bytes - coalesce(json_extract(OLD.record, '$.size'), 0);
END;

CREATE TRIGGER pictures_count AFTER INSERT ON pictures
BEGIN
    UPDATE jobs SET bytes = bytes + coalesce(json_extract(NEW.record, '$.size'), 0)
    WHERE id = NEW.job_id;
END;
CREATE TRIGGER pictures_count_no_more AFTER DELETE ON pictures
BEGIN
    UPDATE jobs SET bytes = bytes - coalesce(json_extract(OLD.record, '$.size'), 0)
    WHERE id = OLD.job_id;
END;

CREATE TRIGGER solutions_count AFTER INSERT ON solutions
BEGIN
    UPDATE jobs SET bytes = bytes + coalesce(json_extract(NEW.record, '$.size'), 0)
                                  + coalesce(json_extract(NEW.record, '$.baked.size'), 0)
    WHERE id = NEW.job_id;
END;
CREATE TRIGGER solutions_count_anew AFTER UPDATE OF record ON solutions
BEGIN
    UPDATE jobs SET bytes = bytes + coalesce(json_extract(NEW.record, '$.size'), 0)
                                  + coalesce(json_extract(NEW.record, '$.baked.size'), 0)
                                  - coalesce(json_extract(OLD.record, '$.size'), 0)
                                  - coalesce(json_extract(OLD.record, '$.baked.size'), 0)
    WHERE id = NEW.job_id;
END;
CREATE TRIGGER solutions_count_no_more AFTER DELETE ON solutions
BEGIN
    UPDATE jobs SET bytes = bytes - coalesce(json_extract(OLD.record, '$.size'), 0)
                                  - coalesce(json_extract(OLD.record, '$.baked.size'), 0)
    WHERE id = OLD.job_id;
END;

-- A job counts for its payer until it is deleted.
CREATE TRIGGER payers_follow_jobs AFTER UPDATE OF bytes, pinned, deleted_ms ON jobs
WHEN OLD.bytes <> NEW.bytes OR OLD.pinned <> NEW.pinned
  OR (OLD.deleted_ms IS NULL) <> (NEW.deleted_ms IS NULL)
BEGIN
    INSERT INTO payers (billed_to, bytes, pinned_bytes) VALUES (NEW.billed_to, 0, 0)
        ON CONFLICT DO NOTHING;
    UPDATE payers SET
        bytes = bytes + iif(NEW.deleted_ms IS NULL, NEW.bytes, 0)
                      - iif(OLD.deleted_ms IS NULL, OLD.bytes, 0),
        pinned_bytes = pinned_bytes
                     + iif(NEW.deleted_ms IS NULL AND NEW.pinned, NEW.bytes, 0)
                     - iif(OLD.deleted_ms IS NULL AND OLD.pinned, OLD.bytes, 0)
    WHERE billed_to = NEW.billed_to;
    DELETE FROM payers WHERE billed_to = NEW.billed_to AND bytes = 0 AND pinned_bytes = 0;
END;
CREATE TRIGGER payers_outlive_jobs AFTER DELETE ON jobs
WHEN OLD.deleted_ms IS NULL AND OLD.bytes <> 0
BEGIN
    UPDATE payers SET bytes = bytes - OLD.bytes,
                      pinned_bytes = pinned_bytes - iif(OLD.pinned, OLD.bytes, 0)
    WHERE billed_to = OLD.billed_to;
END;
