//! Oracles: the same quantities by other means, in f64, without the engine's production path.
//!
//! | module | answers |
//! |---|---|
//! | [`quadrature`] | integrals with singularities at the ends of the range |
//! | [`view_factors`] | view factors by closed forms, by Lambert's formula, by contour integrals |
//! | [`rays`] | what is visible from where, by rays through every facet of a scene; view factors with occlusion |
//! | [`radiosity`] | the radiosity system of a scene, solved densely |
//! | [`paths`] | radiance between diffuse and glossy surfaces by random walks |
//! | [`rooms`] | small scenes to compare on |
//! | [`statistics`] | whether means differ but for chance; χ² of counts |

pub mod paths;
pub mod quadrature;
pub mod radiosity;
pub mod rays;
pub mod rooms;
pub mod statistics;
pub mod view_factors;
