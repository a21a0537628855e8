//! Light transport by hemicube shooting.
//!
//! The modules follow the light: [`radiometry`] names the quantities, [`scene`] says what is
//! there, [`rays`] says what a ray meets, [`patches`] cuts the scene into finite elements,
//! [`hemicube`] turns a shot into pixels, [`device`] runs shots, [`form_factors`] knows the classic
//! routes to compare them with, [`transport`] holds the methods that decide which shots to run,
//! [`measurement`] turns the solution into camera radiance and [`image`] into files.
//! [`render`] ties them together for one job; [`checkpoint`] keeps what one knows.
//!
//! The engine does no networking, knows no async runtime and keeps no global state; only
//! [`scene::gltf`], [`image`] and [`checkpoint`] know file formats.

pub mod radiometry;
pub mod random;
pub mod scene;

pub mod checkpoint;

pub mod rays;

pub mod sampling;
mod surface;

pub mod patches;

mod emitters;
mod filter;

pub mod hemicube;
pub mod raster;

pub mod device;

pub mod form_factors;

pub mod transport;

pub mod measurement;

pub mod image;

pub mod render;
