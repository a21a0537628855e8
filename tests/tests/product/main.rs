//! The product as a whole: rules over all sources and over the documents that name tests, the command
//! that compares methods, the server under load and killed again and again. One program, so that it is
//! linked once; `scripts/kill-loop` runs the kill loop in it alone.

mod compare_command;
mod crowds;
mod dependency_rules;
mod import_graph;
mod kill_loop;
mod load;
mod promises;
mod real_files;
mod settings_table;
