-- Maps of skies are uploads as scenes are: kept once, held, named, counted, expired and let go of
-- alike. So they share the tables `scenes` and `scene_holders`, and `kind` tells them apart. Their
-- ids, hashes of content, cannot meet: no file is both a scene and a map.
ALTER TABLE scenes ADD COLUMN kind TEXT NOT NULL DEFAULT 'scene'
    CHECK (kind IN ('scene', 'environment'));

-- The map that a job's sky is, which stays while the job does.
ALTER TABLE jobs ADD COLUMN environment_id TEXT REFERENCES scenes (id);
CREATE INDEX jobs_by_environment ON jobs (environment_id) WHERE environment_id IS NOT NULL;
