//! What makes maps: showers of light rays, block by block, onto the surfaces that caustics fall on.

use super::charts::{Charts, Receiver};
use super::light_rays::{Casters, LightRays, Lit};
use super::map::{Map, PowerDeposit};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::{IMPORTANCE_WEIGHTS, Rgb, importance};
use crate::surface::World;
use std::collections::BTreeMap;

/// Rays that are shot between looks at the clock, and the least of a pass.
pub const BLOCK: u64 = 1 << 12;
/// Values of the map for a light ray of a shower: with more, keeping the map would take longer than
/// filling it.
const VALUES_PER_RAY: u64 = 8;
/// Most passes that read the same map.
const MOST_PASSES: u64 = 16;
/// Rays that find out where caustics are.
const PILOT: u64 = 1 << 15;
/// Cells of a surface without caustics next to one with the mean irradiance.
const DARK_WEIGHT: f64 = 1.0 / 64.0;
/// Surfaces get more cells with the irradiance's square root, up to this.
const BRIGHT_WEIGHT: f64 = 2.0;

/// What makes maps.
pub struct Maker {
    casters: Casters,
    seed: u64,
    /// The map that passes read.
    pub map: Map,
    /// Passes from one shower to the next.
    interval: u64,
    /// Rays of a shower, even.
    count: u64,
    /// Rays of the shower that is under way.
    shot: u64,
    deposits: u64,
    /// Rays so far.
    pub rays: u64,
}

impl Maker {
    /// Charts the surfaces for `cells` cells; `count` rays are shot for a pass.
    pub fn new(lit: Lit<'_>, casters: Casters, count: u64, cells: u64, seed: u64) -> Self {
        let mut receivers = receivers(lit.world);
        let pilot = LightRays { lit, casters: &casters, count: PILOT, seed };
        weigh(&mut receivers, lit.world, &pilot);
        let map = Map::new(Charts::new(&lit.world.scene, &receivers, cells));
        let interval = (map.len() as u64).div_ceil(VALUES_PER_RAY * count).clamp(1, MOST_PASSES);
        let count = (count * interval).next_multiple_of(2);
        Self { casters, seed, map, interval, count, shot: 0, deposits: 0, rays: 0 }
    }

    /// Whether the map needs another shower, or the rest of one, before that pass.
    pub fn is_behind(&self, pass: u64) -> bool {
        self.map.showers() <= pass / self.interval
    }

    /// Shoots the next block of a shower; what it brought.
    pub fn advance(&mut self, lit: Lit<'_>) -> Vec<PowerDeposit> {
        let light_rays =
            LightRays { lit, casters: &self.casters, count: self.count, seed: self.seed };
        let block = self.shot..(self.shot + BLOCK).min(self.count);
        let shower = light_rays.shoot(self.map.showers(), block);
        self.map.deposit(&shower.deposits);
        self.deposits += shower.deposits.len() as u64;
        self.rays += shower.rays;
        self.shot += BLOCK;
        if self.shot >= self.count {
            self.shot = 0;
            self.map.finish_shower();
        }
        shower.deposits
    }

    /// Shoots a whole shower, or the rest of one; what it brought.
    pub fn shower(&mut self, lit: Lit<'_>) -> Vec<PowerDeposit> {
        let (mut all, showers) = (Vec::new(), self.map.showers());
        while self.map.showers() == showers {
            all.extend(self.advance(lit));
        }
        all
    }

    /// Writes the map and how it was made.
    pub fn save(&self, to: &mut Writer) {
        to.value([self.shot, self.deposits, self.rays]);
        self.map.save(to);
    }

    /// Takes what [`Maker::save`] wrote. Rays for another camera's picture, `others`, are not
    /// counted.
    pub fn restore(&mut self, from: &mut Reader<'_>, others: bool) -> Result<(), CheckpointError> {
        [self.shot, self.deposits, self.rays] = from.value()?;
        if others {
            (self.deposits, self.rays) = (0, 0);
        }
        if !self.shot.is_multiple_of(BLOCK) || self.shot >= self.count {
            return Err(CheckpointError::damaged("no shower is that long"));
        }
        self.map.restore(from)
    }

    /// The map's figures; powers are means over the showers.
    pub fn describe(&self, diagnostics: &mut BTreeMap<String, f64>) {
        let flux = self.map.flux();
        let watts = |power: glam::DVec3| power.dot(IMPORTANCE_WEIGHTS.as_dvec3());
        for (name, value) in [
            ("caustic_flux_landed_watts", watts(flux.landed)),
            ("caustic_flux_in_map_watts", watts(flux.mapped)),
            ("light_ray_landings", self.deposits as f64),
            ("light_rays", self.rays as f64),
            ("map_values", self.map.len() as f64),
        ] {
            diagnostics.insert(name.into(), value);
        }
    }
}

/// The sides of triangles that reflect diffusely anywhere, all with the same weight for their
/// area.
fn receivers(world: &World) -> Vec<Receiver> {
    let scene = &world.scene;
    let mut receivers = Vec::new();
    for index in 0..scene.triangle_count() as u32 {
        let material = scene.material_of(index);
        let opaque = material.clear_share() < 1.0;
        if !opaque || material.reflectance(&material.appearance(Rgb::ONE)).diffuse == Rgb::ZERO {
            continue;
        }
        let (_, area) = world.rays.corners(scene, index);
        let area = area * world.square_metre();
        for back in [false, true] {
            if area > 0.0 && (!back || material.double_sided) {
                let triangle = index;
                receivers.push(Receiver { triangle, back, area, weight: f64::from(area) });
            }
        }
    }
    receivers
}

/// Weighs receivers by what a first shower of light rays brings them: cells go where caustics are.
fn weigh(receivers: &mut [Receiver], world: &World, pilot: &LightRays<'_>) {
    // A pass that no picture has.
    let shower = pilot.shoot(u64::MAX / pilot.count - 1, 0..pilot.count);
    let mut landed = vec![[0.0; 2]; world.scene.triangle_count()];
    for deposit in &shower.deposits {
        landed[deposit.triangle as usize][usize::from(deposit.back)] +=
            f64::from(importance(deposit.power));
    }
    let landed =
        |receiver: &Receiver| landed[receiver.triangle as usize][usize::from(receiver.back)];
    let total: f64 = receivers.iter().map(&landed).sum();
    let area: f64 = receivers.iter().map(|receiver| f64::from(receiver.area)).sum();
    let mean = (total / area).max(f64::MIN_POSITIVE);
    for receiver in receivers {
        let area = f64::from(receiver.area);
        let brightness = (landed(receiver) / area / mean).sqrt().min(BRIGHT_WEIGHT);
        receiver.weight = area * (DARK_WEIGHT + brightness);
    }
}
