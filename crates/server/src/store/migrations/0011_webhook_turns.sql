-- Messages to webhooks take turns. A lane is what one caller sends to one receiver; it is
-- counted here how many messages of each still wait, so that turns and the bound on waiting
-- messages cost the same however many there are.

-- The receiver: host and port of the address. What was stored before may lack the port that the
-- scheme implies, which only makes it a lane of its own.
ALTER TABLE job_webhooks ADD COLUMN host TEXT NOT NULL DEFAULT '';
ALTER TABLE outbox ADD COLUMN host TEXT NOT NULL DEFAULT '';
UPDATE job_webhooks SET host = lower(substr(substr(url, instr(url, '://') + 3), 1,
    instr(substr(url, instr(url, '://') + 3) || '/', '/') - 1));
UPDATE outbox SET host = lower(substr(substr(url, instr(url, '://') + 3), 1,
    instr(substr(url, instr(url, '://') + 3) || '/', '/') - 1)) WHERE next_ms IS NOT NULL;
CREATE INDEX outbox_by_lane ON outbox (owner, host, next_ms) WHERE next_ms IS NOT NULL;

CREATE TABLE webhook_lanes (
    owner    TEXT NOT NULL,                      -- as outbox.owner
    host     TEXT NOT NULL,
    pending  INTEGER NOT NULL,                   -- messages that are neither delivered nor given up
    PRIMARY KEY (owner, host)
) STRICT, WITHOUT ROWID;
INSERT INTO webhook_lanes (owner, host, pending)
    SELECT owner, host, count(*) FROM outbox WHERE next_ms IS NOT NULL GROUP BY owner, host;

CREATE TRIGGER outbox_message_comes AFTER INSERT ON outbox WHEN NEW.next_ms IS NOT NULL
BEGIN
    INSERT INTO webhook_lanes (owner, host, pending) VALUES (NEW.owner, NEW.host, 1)
        ON CONFLICT DO UPDATE SET pending = pending + 1;
END;
CREATE TRIGGER outbox_message_returns AFTER UPDATE OF next_ms ON outbox
WHEN OLD.next_ms IS NULL AND NEW.next_ms IS NOT NULL
BEGIN
    INSERT INTO webhook_lanes (owner, host, pending) VALUES (NEW.owner, NEW.host, 1)
        ON CONFLICT DO UPDATE SET pending = pending + 1;
END;
CREATE TRIGGER outbox_message_ends AFTER UPDATE OF next_ms ON outbox
WHEN OLD.next_ms IS NOT NULL AND NEW.next_ms IS NULL
BEGIN
    UPDATE webhook_lanes SET pending = pending - 1 WHERE owner = OLD.owner AND host = OLD.host;
    DELETE FROM webhook_lanes WHERE owner = OLD.owner AND host = OLD.host AND pending <= 0;
END;
CREATE TRIGGER outbox_message_goes AFTER DELETE ON outbox WHEN OLD.next_ms IS NOT NULL
BEGIN
    UPDATE webhook_lanes SET pending = pending - 1 WHERE owner = OLD.owner AND host = OLD.host;
    DELETE FROM webhook_lanes WHERE owner = OLD.owner AND host = OLD.host AND pending <= 0;
END;

-- As before, with the receiver; without a key, the address that quotas count by is the caller.
DROP TRIGGER jobs_tell_of_their_end;
CREATE TRIGGER jobs_tell_of_their_end AFTER UPDATE OF state ON jobs
WHEN NEW.state IN ('succeeded', 'failed', 'cancelled')
 AND OLD.state NOT IN ('succeeded', 'failed', 'cancelled')
BEGIN
    INSERT INTO outbox (job_id, owner, event, url, host, secret, created_ms, next_ms)
    SELECT NEW.id, iif(NEW.owner <> '', NEW.owner, NEW.billed_to), NEW.state, url, host, secret,
           NEW.finished_ms, NEW.finished_ms
    FROM job_webhooks
    WHERE job_id = NEW.id AND EXISTS (SELECT 1 FROM json_each(events) WHERE value = NEW.state);
END;
