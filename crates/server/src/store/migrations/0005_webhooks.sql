-- Webhooks. The end of a job and its message are one write: a trigger, so that no way to end a
-- job can leave the message out.

CREATE TABLE job_webhooks (
    job_id  TEXT PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    url     TEXT NOT NULL,
    events  TEXT NOT NULL,                       -- JSON list of terminal states
    secret  TEXT                                 -- signs; must be readable for that
) STRICT, WITHOUT ROWID;

CREATE TABLE outbox (
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id        TEXT NOT NULL,                 -- outlives the job
    owner         TEXT NOT NULL,
    event         TEXT NOT NULL,
    url           TEXT NOT NULL,
    secret        TEXT,
    created_ms    INTEGER NOT NULL,
    attempts      INTEGER NOT NULL DEFAULT 0,
    next_ms       INTEGER,                       -- NULL: delivered or given up
    delivered_ms  INTEGER,
    last_answer   TEXT
) STRICT;
CREATE INDEX outbox_due ON outbox (next_ms) WHERE next_ms IS NOT NULL;
CREATE INDEX outbox_by_job ON outbox (job_id);

CREATE TRIGGER jobs_tell_of_their_end AFTER UPDATE OF state ON jobs
WHEN NEW.state IN ('succeeded', 'failed', 'cancelled')
 AND OLD.state NOT IN ('succeeded', 'failed', 'cancelled')
BEGIN
    INSERT INTO outbox (job_id, owner, event, url, secret, created_ms, next_ms)
    SELECT NEW.id, NEW.owner, NEW.state, url, secret, NEW.finished_ms, NEW.finished_ms
    FROM job_webhooks
    WHERE job_id = NEW.id AND EXISTS (SELECT 1 FROM json_each(events) WHERE value = NEW.state);
END;
