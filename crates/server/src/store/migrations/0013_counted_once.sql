-- A file counts once however many records of its job name it: the result of an extension that brought
-- nothing better is recorded again at its end.
DROP TRIGGER pictures_count;
DROP TRIGGER pictures_count_no_more;
CREATE INDEX pictures_by_content ON pictures (job_id, sha256, format);
CREATE TRIGGER pictures_count AFTER INSERT ON pictures
WHEN NOT EXISTS (SELECT 1 FROM pictures WHERE job_id = NEW.job_id AND sha256 = NEW.sha256
                   AND format = NEW.format AND seq <> NEW.seq)
BEGIN
    UPDATE jobs SET bytes = bytes + coalesce(json_extract(NEW.record, '$.size'), 0)
    WHERE id = NEW.job_id;
END;
CREATE TRIGGER pictures_count_no_more AFTER DELETE ON pictures
WHEN NOT EXISTS (SELECT 1 FROM pictures WHERE job_id = OLD.job_id AND sha256 = OLD.sha256
                   AND format = OLD.format)
BEGIN
    UPDATE jobs SET bytes = bytes - coalesce(json_extract(OLD.record, '$.size'), 0)
    WHERE id = OLD.job_id;
END;
UPDATE jobs SET bytes =
      (SELECT coalesce(sum(size), 0) FROM
          (SELECT max(json_extract(record, '$.size')) AS size FROM pictures
           WHERE job_id = jobs.id GROUP BY sha256, format))
    + coalesce((SELECT json_extract(record, '$.size') + coalesce(json_extract(record, '$.baked.size'), 0)
                FROM solutions WHERE job_id = jobs.id), 0)
WHERE id IN (SELECT job_id FROM pictures GROUP BY job_id, sha256, format HAVING count(*) > 1);

-- Jobs that make no room, with their scenes: pinned, not ended, or without files.
CREATE INDEX jobs_that_stay ON jobs (scene_id, bytes)
    WHERE deleted_ms IS NULL AND (pinned = 1 OR finished_ms IS NULL OR bytes = 0);

-- Messages that are delivered or given up, by age.
CREATE INDEX outbox_over ON outbox (created_ms) WHERE next_ms IS NULL;
