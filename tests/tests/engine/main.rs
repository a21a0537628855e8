//! The engine, called in process: against oracles in f64, other methods, itself on another device, and
//! on scenes on which it could fail. One program, so that it is linked once and its tests share the cores.

mod backgrounds;
mod checkpoints;
mod comparators;
mod convergence;
mod drafts;
mod expectation;
mod furnace;
mod glass;
mod glossy;
mod hemilux;
mod highlights;
mod illumination_map;
mod instances;
mod layers;
mod malformed_scenes;
mod methods;
mod normal_maps;
mod oracles;
mod patchless_light;
mod pictures;
mod ray_traced;
mod real_light;
mod real_scenes;
mod references;
mod shared_scenes;
mod soft_lights;
mod stability;
mod stability_geometry;
mod stability_switches;
mod switches;
mod target_error;
mod textures;
mod translucent;
mod twins;
mod wide_scenes;
