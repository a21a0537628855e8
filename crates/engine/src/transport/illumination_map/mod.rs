//! Illumination maps (Arvo 1986, as Rogers prints them): rays from the lights, through mirrors and
//! clear bodies onto diffuse surfaces, are collected in maps on those; then a picture is traced
//! from the camera that reads them. It shows the caustics that patches miss.
//!
//! What is in the map is light that came from an emitter by one or more sharp lobes
//! ([`crate::radiometry::Reflectance::is_sharp`]) or clear surfaces, and nothing else; walks from
//! the camera leave out exactly that after a diffuse reflection, and bring all other light
//! themselves. So nothing counts twice, and nothing is missing.
//!
//! Light rays come in showers, and camera passes in between; a pass reads the light of all showers
//! before it. The scatter of the passes says how far off the camera's walks are, and the difference
//! of two halves of the showers how far off the map is.

mod charts;
mod light_rays;
mod map;

use super::Method;
use super::kept::{Parts, Past};
use super::options::Settings;
use super::ray_traced::{
    Caustics, DiskPoints, Disks, Film, Lights, Pixels, RayTracedSettings, Tracer, World, warnings,
};
use super::run::Run;
use super::stage::{Asked, Record};
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, DeviceError, free_memory};
use crate::image::Picture;
use crate::measurement::Frame;
use crate::radiometry::{IMPORTANCE_WEIGHTS, Rgb, importance};
use crate::render::{Observer, RenderError, RenderRequest, Rendered, StopReason};
use crate::scene::{Camera, Warning};
use charts::{Charts, Receiver};
use light_rays::{Casters, LightRays};
use map::Map;
use std::collections::BTreeMap;
use std::time::Instant;

/// Aim of one step, seconds: short enough to cancel, long enough not to matter.
const STEP_SECONDS: f64 = 0.04;
/// Pause between error estimates, in times of what the last one took.
const ESTIMATE_PAUSE: f64 = 10.0;
/// Rays that are shot between looks at the clock, and the least of a pass.
const BLOCK: u64 = 1 << 12;
/// Values of the map for a light ray of a shower: with more, keeping the map would take longer than
/// filling it.
const VALUES_PER_RAY: u64 = 8;
/// Most passes that read the same map.
const MOST_PASSES: u64 = 16;
/// Most rays from the lights for a pass.
const MOST_RAYS: u64 = 1 << 20;
/// Rays of a shower, for one pass, in checkpoints.
const LIGHT_RAYS: &str = "light_rays";
/// Rays that find out where caustics are.
const PILOT: u64 = 1 << 15;
/// Cells of a surface without caustics next to one with the mean irradiance.
const DARK_WEIGHT: f64 = 1.0 / 64.0;
/// Surfaces get more cells with the irradiance's square root, up to this.
const BRIGHT_WEIGHT: f64 = 2.0;

/// Light rays into maps, and a camera pass that reads them.
pub struct IlluminationMap;

/// Checked settings of illumination maps; see [`crate::transport::OPTIONS`] for their meaning.
#[derive(Clone, Copy, Debug)]
pub struct MapSettings {
    /// Rays from the lights a pass; `None` follows the picture's size.
    light_rays: Option<u64>,
    /// Cells of the map.
    cells: u64,
}

impl MapSettings {
    /// Reads the settings of illumination maps.
    ///
    /// # Errors
    /// [`RenderError::Parameter`] for a value out of range.
    pub fn new(settings: &Settings) -> Result<Self, RenderError> {
        let light_rays = match settings.values()["light_rays"].as_str() {
            "auto" => None,
            _ => Some(settings.whole("light_rays", 2, MOST_RAYS)?),
        };
        Ok(Self { light_rays, cells: settings.whole("map_texels", 1, 1 << 24)? })
    }
}

impl Method for IlluminationMap {
    fn name(&self) -> &'static str {
        "illumination-map"
    }

    fn checkpoint_format(&self) -> u32 {
        1
    }

    fn summary(&self) -> &'static str {
        "light rays through mirrors and glass into maps on diffuse surfaces, and path tracing from the camera that reads them: caustics"
    }

    fn render(
        &self,
        device: &mut dyn Device,
        request: &RenderRequest,
        reasons: Vec<String>,
        observer: &mut dyn Observer,
    ) -> Result<Rendered, RenderError> {
        let settings = Settings::new(&request.options)?;
        let options = RayTracedSettings::new(&settings)?;
        let own = MapSettings::new(&settings)?;
        let past = Past::of(request, self.name(), &settings)?;
        let triangles = request.scene.triangles.len();
        check_memory(triangles as u64, &own, request)?;
        let asked = Asked { method: self.name(), reasons, request, settings: &settings };
        let mut record = Record::new(asked, format!("{} (rays)", CpuDevice::describe_here().name))?;
        let world = World::new(request.scene.clone());
        let lights = Lights::new(&world);
        let casters = Casters::new(&world);
        let mut warnings = warnings(&world, &options, &device.description());
        if casters.is_none() {
            warnings.push(Warning::new(
                "scene",
                "nothing mirrors sharply or lets light through, so there are no caustics to map; ray-traced shows the same",
            ));
        }
        record.announce((0, triangles), lights.is_some(), warnings, observer);

        let mut run = record.run(request, observer);
        let mut diagnostics = BTreeMap::new();
        let result = match &lights {
            Some(lights) => {
                let camera = &record.camera;
                let disks = options.disks(&world, lights);
                let job = Job { world: &world, lights, disks, camera, request, options, own };
                job.solve(&mut run, casters.as_ref(), past, &mut diagnostics)?
            }
            None => (record.black(), StopReason::NoLight),
        };
        let rays = run.tally.shots as f64;
        diagnostics.insert("rays".into(), rays);
        diagnostics.insert("rays_per_second".into(), rays / run.seconds());
        Ok(record.rendered(run, result, diagnostics))
    }
}

/// Refuses what would not fit into memory before anything is allocated.
fn check_memory(
    triangles: u64,
    own: &MapSettings,
    request: &RenderRequest,
) -> Result<(), DeviceError> {
    let needed_bytes = World::needed_bytes(triangles)
        + Film::needed_bytes(request.width, request.height)
        + Charts::needed_bytes(2 * triangles, own.cells);
    let available_bytes = free_memory();
    if needed_bytes > available_bytes {
        let device = CpuDevice::describe().id;
        return Err(DeviceError::OutOfMemory { device, needed_bytes, available_bytes });
    }
    Ok(())
}

/// The sides of triangles that reflect diffusely anywhere, all with the same weight for their
/// area.
fn receivers(world: &World) -> Vec<Receiver> {
    let scene = &world.scene;
    let mut receivers = Vec::new();
    for (index, triangle) in scene.triangles.iter().enumerate() {
        let material = &scene.materials[triangle.material as usize];
        let opaque = material.clear_share() < 1.0;
        if !opaque || material.reflectance(Rgb::ONE).diffuse == Rgb::ZERO {
            continue;
        }
        let (_, area) = world.rays.corners(scene, index as u32);
        let area = area * world.square_metre();
        for back in [false, true] {
            if area > 0.0 && (!back || material.double_sided) {
                let triangle = index as u32;
                receivers.push(Receiver { triangle, back, area, weight: f64::from(area) });
            }
        }
    }
    receivers
}

/// A job with light.
struct Job<'a> {
    world: &'a World,
    lights: &'a Lights,
    disks: Option<(Disks, DiskPoints)>,
    camera: &'a Camera,
    request: &'a RenderRequest,
    options: RayTracedSettings,
    own: MapSettings,
}

/// The film, and when its error was estimated last.
struct Exposure {
    film: Film,
    estimated: Instant,
    estimate_seconds: f64,
}

/// What makes maps.
struct Maker<'a> {
    light_rays: LightRays<'a>,
    map: Map,
    /// Passes from one shower to the next.
    interval: u64,
    /// Rays of the shower that is under way.
    shot: u64,
    landings: u64,
    rays: u64,
}

impl Job<'_> {
    /// Makes passes until a limit is reached.
    fn solve(
        &self,
        run: &mut Run<'_>,
        casters: Option<&Casters>,
        past: Option<Past<'_>>,
        diagnostics: &mut BTreeMap<String, f64>,
    ) -> Result<(Picture, StopReason), RenderError> {
        let automatic = u64::from(self.request.width) * u64::from(self.request.height);
        let mut count = self.own.light_rays.unwrap_or(automatic.clamp(BLOCK, MOST_RAYS));
        if let Some(past) = &past {
            // Showers of another length would shoot some rays twice.
            count = past.decided::<u64>(LIGHT_RAYS)?.clamp(2, MOST_RAYS);
        }
        run.owner.decided.insert(LIGHT_RAYS.into(), count.to_string());
        let mut maker = casters.map(|casters| self.maker(casters, count));
        let film = Film::new([self.request.width, self.request.height], self.options.period());
        let mut exposure = Exposure { film, estimated: Instant::now(), estimate_seconds: 0.0 };
        if let Some(mut past) = past {
            if let Some(maker) = &mut maker {
                maker.restore(&mut past.shared, past.bound.is_none())?;
            }
            past.shared.end()?;
            if let Some(mut bound) = past.bound {
                exposure.film.restore(&mut bound)?;
                bound.end()?;
            }
        }
        let stopped = loop {
            if let Err(stop) = self.pass(run, maker.as_mut(), &mut exposure) {
                break stop?;
            }
        };
        run.keep_solution(|parts| save(parts, maker.as_ref(), &exposure.film))?;
        run.estimated_error = exposure.film.relative_error();
        if let Some(maker) = maker {
            maker.describe(diagnostics);
        }
        Ok((exposure.film.picture(), stopped))
    }

    fn maker<'b>(&'b self, casters: &'b Casters, count: u64) -> Maker<'b> {
        let rays_of = |count: u64| LightRays {
            world: self.world,
            lights: self.lights,
            casters,
            count: count.next_multiple_of(2),
            seed: self.request.seed,
        };
        let mut receivers = receivers(self.world);
        weigh(&mut receivers, self.world, &rays_of(PILOT));
        let map = Map::new(Charts::new(&self.world.scene, &receivers, self.own.cells));
        let interval = (map.len() as u64).div_ceil(VALUES_PER_RAY * count).clamp(1, MOST_PASSES);
        let light_rays = rays_of(count * interval);
        Maker { light_rays, map, interval, shot: 0, landings: 0, rays: 0 }
    }

    fn pixels<'b>(&'b self, caustics: Option<&'b dyn Caustics>) -> Pixels<'b> {
        let size = [self.request.width, self.request.height];
        Pixels {
            tracer: Tracer {
                world: self.world,
                lights: self.lights,
                disks: self.disks.as_ref().map(|(disks, points)| (disks, *points)),
                reflections: self.options.reflections,
                rays_per_pixel: self.options.rays_per_pixel,
                caustics,
            },
            frame: Frame::new(self.camera, size[0], size[1]),
            size,
            sampling: self.options.pixel_sampling,
            path_strata: self.options.spreads_paths(),
            seed: self.request.seed,
        }
    }

    /// A map from fresh light, and an estimate of every pixel that reads it, or what of that an
    /// earlier run has left to do. Fails with the reason to stop, or with what went wrong.
    fn pass(
        &self,
        run: &mut Run<'_>,
        mut maker: Option<&mut Maker<'_>>,
        exposure: &mut Exposure,
    ) -> Result<(), Result<StopReason, DeviceError>> {
        let pass = exposure.film.passes();
        if let Some(maker) = maker.as_deref_mut()
            && maker.map.showers() <= pass / maker.interval
        {
            maker.shower(run, &exposure.film)?;
        }
        let light_rays = maker.as_deref().map_or(0, |maker| maker.rays);
        let pixels = self.pixels(maker.as_deref().map(|maker| &maker.map as &dyn Caustics));
        let height = exposure.film.height();
        let (mut row, mut step) = (exposure.film.next_row(), height.min(4));
        while row < height {
            if let Some(reason) = run.stop() {
                return Err(Ok(reason));
            }
            let began = Instant::now();
            let rows = row..(row + step).min(height);
            let count = f64::from(rows.end - rows.start);
            row = rows.end;
            exposure.film.advance(&pixels, rows, 1);
            let per_row = began.elapsed().as_secs_f64().max(1e-9) / count;
            step = ((STEP_SECONDS / per_row) as u32).clamp(1, height);
            run.tally.iterations = exposure.film.passes();
            run.tally.shots = exposure.film.rays() + light_rays;
            run.tally.light_shots = exposure.film.light_rays() + light_rays;
            exposure.report(run);
            let kept = run.keep_if_wanted(|parts| save(parts, maker.as_deref(), &exposure.film));
            kept.map_err(Err)?;
        }
        Ok(())
    }
}

/// The map is for any camera, the film for its own.
fn save(parts: &mut Parts, maker: Option<&Maker<'_>>, film: &Film) -> Result<(), DeviceError> {
    if let Some(maker) = maker {
        maker.save(&mut parts.shared);
    }
    film.save(&mut parts.bound);
    Ok(())
}

impl Exposure {
    /// Reports, if it is time, with an error estimate, if that takes a small share of the time.
    fn report(&mut self, run: &mut Run<'_>) {
        if !run.report_is_due() {
            return;
        }
        if self.estimated.elapsed().as_secs_f64() >= ESTIMATE_PAUSE * self.estimate_seconds {
            let began = Instant::now();
            run.estimated_error = self.film.relative_error();
            run.without_estimate = run.estimated_error.is_none() && self.film.enough();
            self.estimate_seconds = began.elapsed().as_secs_f64();
            self.estimated = Instant::now();
        }
        run.report(run.tally.iterations > 0, || self.film.picture());
    }
}

impl Maker<'_> {
    /// Writes the map and how it was made.
    fn save(&self, to: &mut Writer) {
        to.value([self.shot, self.landings, self.rays]);
        self.map.save(to);
    }

    /// Takes what [`Maker::save`] wrote. Rays for another camera's picture, `others`, are not
    /// counted.
    fn restore(&mut self, from: &mut Reader<'_>, others: bool) -> Result<(), CheckpointError> {
        [self.shot, self.landings, self.rays] = from.value()?;
        if others {
            (self.landings, self.rays) = (0, 0);
        }
        if !self.shot.is_multiple_of(BLOCK) || self.shot >= self.light_rays.count {
            return Err(CheckpointError::damaged("no shower is that long"));
        }
        self.map.restore(from)
    }

    /// Shoots new light into the map, or the rest of a shower that is under way.
    fn shower(
        &mut self,
        run: &mut Run<'_>,
        film: &Film,
    ) -> Result<(), Result<StopReason, DeviceError>> {
        let (number, count) = (self.map.showers(), self.light_rays.count);
        while self.shot < count {
            if let Some(reason) = run.stop() {
                return Err(Ok(reason));
            }
            let first = self.shot;
            let shower = self.light_rays.shoot(number, first..(first + BLOCK).min(count));
            self.map.deposit(&shower.landings);
            self.landings += shower.landings.len() as u64;
            self.rays += shower.rays;
            if run.report_is_due() {
                run.report_progress();
            }
            self.shot += BLOCK;
            // The end of a shower is nothing that a checkpoint could be made of.
            if self.shot < count {
                run.keep_if_wanted(|parts| save(parts, Some(self), film)).map_err(Err)?;
            }
        }
        self.shot = 0;
        self.map.finish_shower();
        Ok(())
    }

    /// The map's figures; powers are means over the showers.
    fn describe(&self, diagnostics: &mut BTreeMap<String, f64>) {
        let flux = self.map.flux();
        let watts = |power: glam::DVec3| power.dot(IMPORTANCE_WEIGHTS.as_dvec3());
        for (name, value) in [
            ("caustic_flux_landed_watts", watts(flux.landed)),
            ("caustic_flux_in_map_watts", watts(flux.mapped)),
            ("light_ray_landings", self.landings as f64),
            ("light_rays", self.rays as f64),
            ("map_values", self.map.len() as f64),
        ] {
            diagnostics.insert(name.into(), value);
        }
    }
}

/// Weighs receivers by what a first shower of light rays brings them: cells go where caustics are.
fn weigh(receivers: &mut [Receiver], world: &World, pilot: &LightRays<'_>) {
    // A pass that no picture has.
    let shower = pilot.shoot(u64::MAX / pilot.count - 1, 0..pilot.count);
    let mut landed = vec![[0.0; 2]; world.scene.triangles.len()];
    for landing in &shower.landings {
        landed[landing.triangle as usize][usize::from(landing.back)] +=
            f64::from(importance(landing.power));
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
