-- API keys; whose a job and a scene are; what counts towards whose quota.

CREATE TABLE api_keys (
    id            TEXT PRIMARY KEY,
    name          TEXT NOT NULL,
    hash          TEXT NOT NULL UNIQUE,          -- SHA-256 of the whole key; the key is nowhere
    scopes        TEXT NOT NULL,                 -- JSON list
    limits        TEXT NOT NULL,                 -- JSON, the key's own quotas
    webhook       TEXT,                          -- JSON, told of every job that names no other
    created_ms    INTEGER NOT NULL,
    expires_ms    INTEGER,
    revoked_ms    INTEGER,                       -- kept, so that the service stays closed
    last_used_ms  INTEGER
) STRICT;
CREATE UNIQUE INDEX api_keys_by_name ON api_keys (name) WHERE revoked_ms IS NULL;

ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';     -- a key's id; '' without keys
ALTER TABLE jobs ADD COLUMN billed_to TEXT NOT NULL DEFAULT ''; -- whose quota: a key, an address
ALTER TABLE jobs ADD COLUMN max_running INTEGER;                -- the quota when it was accepted
ALTER TABLE jobs ADD COLUMN trace_parent TEXT;                  -- W3C, of the request

DROP INDEX jobs_by_key;
CREATE UNIQUE INDEX jobs_by_key ON jobs (owner, idempotency_key)
    WHERE idempotency_key IS NOT NULL AND deleted_ms IS NULL;
CREATE INDEX jobs_by_owner ON jobs (owner, id);
CREATE INDEX jobs_open_by_payer ON jobs (billed_to, state)
    WHERE state IN ('queued', 'running') AND deleted_ms IS NULL;

CREATE TABLE scene_holders (
    scene_id  TEXT NOT NULL REFERENCES scenes (id) ON DELETE CASCADE,
    holder    TEXT NOT NULL,                     -- as jobs.billed_to
    PRIMARY KEY (scene_id, holder)
) STRICT, WITHOUT ROWID;
CREATE INDEX scene_holders_by_holder ON scene_holders (holder);
