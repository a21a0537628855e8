-- Scenes, jobs, their events and pictures. Times are milliseconds since 1970; JSON columns hold
-- the API's own types.

CREATE TABLE scenes (
    id          TEXT PRIMARY KEY,
    created_ms  INTEGER NOT NULL,
    record      TEXT NOT NULL
) STRICT;
CREATE INDEX scenes_by_time ON scenes (created_ms, id);

CREATE TABLE jobs (
    id               TEXT PRIMARY KEY,          -- UUIDv7: sorts by age
    scene_id         TEXT NOT NULL REFERENCES scenes (id),
    state            TEXT NOT NULL
        CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    priority         INTEGER NOT NULL,
    created_ms       INTEGER NOT NULL,
    started_ms       INTEGER,
    finished_ms      INTEGER,
    deleted_ms       INTEGER,                   -- hidden now, purged later
    attempts         INTEGER NOT NULL DEFAULT 0,
    fence            INTEGER NOT NULL DEFAULT 0, -- grows with every claim; workers write under it
    lease_owner      TEXT,                      -- the process that runs it
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    last_seq         INTEGER NOT NULL DEFAULT 0,
    idempotency_key  TEXT,
    request_hash     TEXT NOT NULL,
    request          TEXT NOT NULL,
    device           TEXT,
    progress         TEXT,
    plan             TEXT,
    warnings         TEXT NOT NULL DEFAULT '[]',
    stats            TEXT,
    error            TEXT,
    result           TEXT,
    CHECK ((state = 'running') = (lease_owner IS NOT NULL))
) STRICT;
CREATE INDEX jobs_queue ON jobs (priority DESC, id) WHERE state = 'queued' AND deleted_ms IS NULL;
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_deleted ON jobs (deleted_ms) WHERE deleted_ms IS NOT NULL;
CREATE UNIQUE INDEX jobs_by_key ON jobs (idempotency_key)
    WHERE idempotency_key IS NOT NULL AND deleted_ms IS NULL;

CREATE TABLE job_labels (
    job_id  TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    key     TEXT NOT NULL,
    value   TEXT NOT NULL,
    PRIMARY KEY (job_id, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_labels_by_value ON job_labels (key, value, job_id);

CREATE TABLE events (
    job_id  TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq     INTEGER NOT NULL,
    kind    TEXT NOT NULL,
    at_ms   INTEGER NOT NULL,
    data    TEXT NOT NULL,
    PRIMARY KEY (job_id, seq)
) STRICT, WITHOUT ROWID;

CREATE TABLE pictures (
    job_id  TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq     INTEGER NOT NULL,                   -- the event that announced it
    sha256  TEXT NOT NULL,
    format  TEXT NOT NULL CHECK (format IN ('png', 'exr')),
    record  TEXT NOT NULL,
    PRIMARY KEY (job_id, format, seq)
) STRICT, WITHOUT ROWID;
