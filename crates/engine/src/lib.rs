//! Light transport: a scene becomes a picture.
//!
//! The modules follow the light: `angles` measures, [`radiometry`] names the quantities, [`scene`]
//! says what is there, [`rays`] says what a ray meets, [`sampling`] draws directions and points, `surface` says
//! what a point reflects and lets through, [`patches`] cuts the scene into finite elements,
//! `emitters` asks what shines, `filter` lets neighbours say together what one says badly,
//! [`hemicube`] turns a shot into pixels, [`device`] runs shots, [`form_factors`] knows the classic
//! routes to compare them with, [`measurement`] turns a solution into camera radiance and [`image`]
//! into files. [`render`] has the words of a job, [`checkpoint`] keeps what one knows, and
//! [`transport`] holds the methods and the driver that runs them.
//!
//! The engine does no networking, knows no async runtime and keeps no global state; only
//! [`scene::gltf`], [`image`] and [`checkpoint`] know file formats.

#![cfg_attr(not(test), warn(clippy::too_many_lines))]

mod angles;
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
