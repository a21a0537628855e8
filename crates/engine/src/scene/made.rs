//! Scenes made by code: the project's own test and example scenes.
