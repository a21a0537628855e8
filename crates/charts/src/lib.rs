//! Judging pictures, and drawing what came out.
//!
//! [`accuracy`] says how far pictures are from a reference, [`blur`] what is left of that from afar,
//! [`regions`] over which pixels,
//! [`statistics`] what repetitions tell. [`chart`] draws lines on logarithmic axes as SVG and PNG,
//! [`sheet`] puts pictures side by side, [`table`] writes CSV and Markdown. [`comparison`] runs
//! methods side by side and uses all of them.
//!
//! Everything is drawn without fonts of the system: SVG files name a generic family, letters in
//! PNG files come with the program.

#![cfg_attr(not(test), warn(clippy::too_many_lines))]

pub mod accuracy;
pub mod blur;
pub mod chart;
pub mod comparison;
mod letters;
mod raster;
pub mod regions;
pub mod sheet;
pub mod statistics;
pub mod table;
