-- What jobs know about the light of their scene: the latest checkpoint of each, or what it begins
-- with. Rows of deleted jobs go with them; the files go with the job's folder.
CREATE TABLE solutions (
    job_id  TEXT PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    record  TEXT NOT NULL
) STRICT, WITHOUT ROWID;
