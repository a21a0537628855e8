-- How attempts end, and whose turn it is.

-- Whether the latest attempt runs in a process of its own: then the server's death is not its doing.
ALTER TABLE jobs ADD COLUMN own_process INTEGER NOT NULL DEFAULT 0;
-- Attempts that do not count: deaths of the server beside the job's own process, and deaths of that
-- process for want of memory while other jobs ran. The latter are counted once more by themselves.
ALTER TABLE jobs ADD COLUMN interruptions INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN memory_deaths INTEGER NOT NULL DEFAULT 0;
-- Whether nothing may run beside it, and how many jobs were claimed before it for that reason.
ALTER TABLE jobs ADD COLUMN runs_alone INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN passed_over INTEGER NOT NULL DEFAULT 0;

-- The order among the jobs of one payer and priority: later for what was accepted later, and for what
-- lets others go first. No time: clocks jump.
ALTER TABLE jobs ADD COLUMN place INTEGER NOT NULL DEFAULT 0;
UPDATE jobs SET place = rowid;
CREATE INDEX jobs_by_place ON jobs (place);

-- When each payer (jobs.billed_to) last had a turn, counted in turns.
CREATE TABLE turns (
    payer  TEXT PRIMARY KEY,
    last   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE INDEX turns_by_last ON turns (last);

DROP INDEX jobs_queue;
CREATE INDEX jobs_queue ON jobs (priority, billed_to, place)
    WHERE state = 'queued' AND deleted_ms IS NULL;
CREATE INDEX jobs_queue_by_quota ON jobs (billed_to, max_running)
    WHERE state = 'queued' AND deleted_ms IS NULL;
