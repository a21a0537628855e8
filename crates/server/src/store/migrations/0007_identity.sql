-- What the store knows of itself: its id, whether the folder of files bears that id, the newest
-- time that it trusts.
CREATE TABLE meta (
    key    TEXT PRIMARY KEY,
    value  TEXT NOT NULL
) STRICT, WITHOUT ROWID;
