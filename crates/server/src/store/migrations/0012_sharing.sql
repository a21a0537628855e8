-- Scenes are shared by their content, and each of those who sent one sees it as their own: since
-- when they have had it, and what they call it. Who lets go of a scene leaves it to the others.

ALTER TABLE scene_holders ADD COLUMN created_ms INTEGER NOT NULL DEFAULT 0; -- the holder's first time
ALTER TABLE scene_holders ADD COLUMN name TEXT;                             -- the holder's name for it
UPDATE scene_holders
    SET created_ms = (SELECT created_ms FROM scenes WHERE scenes.id = scene_id);
DROP INDEX scene_holders_by_holder;
CREATE INDEX scene_holders_by_holder ON scene_holders (holder, created_ms, scene_id);

-- The last of its holders let go of it: it stays for the jobs that name it, and goes with them.
ALTER TABLE scenes ADD COLUMN let_go INTEGER NOT NULL DEFAULT 0;
CREATE INDEX scenes_let_go ON scenes (id) WHERE let_go = 1;

-- What the scene was called when the job was accepted.
ALTER TABLE jobs ADD COLUMN scene_name TEXT;
