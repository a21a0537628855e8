-- Leases that are renewed, what went wrong in earlier attempts, and results that jobs share.

-- Counts the holder's signs of life. Times of day would not do: clocks jump.
ALTER TABLE jobs ADD COLUMN lease_beat INTEGER NOT NULL DEFAULT 0;
-- How many of the attempts ended with their server.
ALTER TABLE jobs ADD COLUMN outages INTEGER NOT NULL DEFAULT 0;
-- JSON list: one sentence for each counted attempt that came to nothing.
ALTER TABLE jobs ADD COLUMN mishaps TEXT NOT NULL DEFAULT '[]';
-- Hash of everything that the picture depends on, where that determines it.
ALTER TABLE jobs ADD COLUMN render_key TEXT;
-- The identical job whose result this one shares.
ALTER TABLE jobs ADD COLUMN result_of TEXT;

CREATE INDEX jobs_by_render_key ON jobs (render_key, state) WHERE render_key IS NOT NULL;
