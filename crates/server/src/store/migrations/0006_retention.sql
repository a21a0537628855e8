-- What is kept and what expires.

ALTER TABLE jobs ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;  -- never expires
ALTER TABLE scenes ADD COLUMN used_ms INTEGER NOT NULL DEFAULT 0; -- last sent or named by a job
UPDATE scenes SET used_ms = created_ms;
CREATE INDEX jobs_expiring ON jobs (finished_ms)
    WHERE finished_ms IS NOT NULL AND pinned = 0 AND deleted_ms IS NULL;
CREATE INDEX jobs_by_scene ON jobs (scene_id);
