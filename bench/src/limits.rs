//! `limits`: what the processor device does in a second beside what the machine can do at all:
//! copied bytes, random cache lines, multiplications; and where the time of a picture goes.

use crate::page::percent;
use crate::results::{self, Failure};
use crate::views::imported;
use glam::Vec3;
use hemilux_charts::statistics::median;
use hemilux_charts::table::Table;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::device::{Device, ShootingSettings};
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::rays::{Eye, Hit, Rays};
use hemilux_engine::render::{Limits, RenderRequest, Rendered, Unobserved};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use std::hint::black_box;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::Instant;

/// Floats that a thread copies: far more than caches hold.
const COPIED: usize = 1 << 25;
/// Bytes of a cache line, and of the table that random ones are read from.
const LINE: usize = 64;
const TABLE: usize = 1 << 28;
/// Random lines that a thread asks for at once.
const AT_ONCE: usize = 16;
/// Independent sums of a thread's multiplications: enough to hide their latency.
const SUMS: usize = 256;
/// Rays of a measurement, per thread.
const RAYS: usize = 200_000;
const TRIANGLES: [usize; 3] = [1_000, 10_000, 100_000];
const RESOLUTION: u32 = 256;
/// Bytes that a pixel of the item buffer takes: depth and patch.
const PIXEL: f64 = 8.0;

#[derive(clap::Args)]
pub struct Arguments {
    /// Rounds; the median counts.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Seconds of shooting in a round.
    #[arg(long, default_value_t = 0.5)]
    seconds: f64,
    /// Page whose generated part is rewritten.
    #[arg(long)]
    page: Option<PathBuf>,
}

/// Random numbers that cost nothing beside what is measured (xorshift, Marsaglia 2003).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / 16_777_216.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let point = Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0;
            let square = point.length_squared();
            if (0.01..1.0).contains(&square) {
                return point / square.sqrt();
            }
        }
    }
}

/// What the machine does in a second.
struct Machine {
    /// Bytes read and written by copying.
    copied: f64,
    /// Random cache lines read.
    lines: f64,
    /// Fused multiply-adds.
    sums: f64,
}

impl Machine {
    fn measured(rounds: usize) -> Self {
        let (mut copied, mut lines, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..rounds {
            copied.push(copies());
            lines.push(random_lines());
            sums.push(multiplications());
        }
        Self { copied: median(copied), lines: median(lines), sums: median(sums) }
    }

    fn table(&self) -> Table {
        let Self { copied, lines, sums } = self;
        let mut table = Table::new(&["what the machine can do", "a second"]);
        table.add(vec!["bytes copied, read and written".into(), format!("{:.1} GB", copied / 1e9)]);
        table.add(vec!["random cache lines".into(), format!("{:.0} million", lines / 1e6)]);
        table.add(vec!["fused multiply-adds, f32".into(), format!("{:.0} billion", sums / 1e9)]);
        table
    }
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let rounds = arguments.rounds.max(1);
    let machine = Machine::measured(rounds);
    let mut rays = Table::new(&[
        "triangles",
        "closest hits/s",
        "shadow rays/s",
        "lines in the time of a hit",
        "multiply-adds in the time of a hit",
    ]);
    let mut shots =
        Table::new(&["triangles", "shots/s", "pixels/s", "triangles/s", "of the bytes copied"]);
    for triangles in TRIANGLES {
        let scene = Arc::new(imported(&made::tessellated_room(triangles)));
        let (hits, shadows) = tracing(&scene, rounds);
        rays.add(vec![
            triangles.to_string(),
            format!("{:.2} million", hits / 1e6),
            format!("{:.2} million", shadows / 1e6),
            format!("{:.0}", machine.lines / hits),
            format!("{:.0}", machine.sums / hits),
        ]);
        let patched = Arc::new(PatchedScene::new(scene.clone(), scene.triangles.len()));
        let rates: Result<Vec<f64>, Failure> =
            (0..rounds).map(|_| shooting(&patched, arguments.seconds)).collect();
        let rate = median(rates?);
        // A whole face and four halves.
        let pixels = 3.0 * f64::from(RESOLUTION).powi(2) * rate;
        shots.add(vec![
            triangles.to_string(),
            format!("{rate:.0}"),
            format!("{:.0} million", pixels / 1e6),
            format!("{:.1} million", rate * scene.triangles.len() as f64 / 1e6),
            percent(pixels * PIXEL / machine.copied),
        ]);
    }
    let text = format!(
        "{}\n{}\nRays of random directions from random places of a room:\n\n{}\nHemicube shots, R = \
         {RESOLUTION}, {PIXEL} bytes a pixel:\n\n{}\nShares of the solving time, 500 × 500 pixels, 3 s:\
         \n\n{}",
        results::machine(),
        machine.table().markdown(),
        rays.markdown(),
        shots.markdown(),
        stages()?.markdown()
    );
    results::publish(arguments.page.as_deref(), &[("limits".into(), text)])
}

/// Closest hits and shadow rays a second inside a scene.
fn tracing(scene: &Scene, rounds: usize) -> (f64, f64) {
    let world = Rays::new(scene);
    let (low, high) = scene.bounds().unwrap_or_default();
    let inside = |chance: &mut Chance| {
        let at = Vec3::new(chance.unit(), chance.unit(), chance.unit());
        world.place(low + (0.1 + 0.8 * at) * (high - low))
    };
    let (mut hits, mut shadows) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        // From one surface to another, as light goes.
        hits.push(by_all_threads(RAYS, |chance| {
            let start = inside(chance);
            let hit: Option<Hit> = world.closest(Eye::Light, start, chance.direction());
            black_box(hit);
        }));
        shadows.push(by_all_threads(RAYS, |chance| {
            let (from, to) = (inside(chance), inside(chance));
            black_box(world.blocked(from, to, |_| false));
        }));
    }
    (median(hits), median(shadows))
}

fn threads() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Runs `work` on every thread; what all got done a second, where it tells how much it did.
fn together(work: impl Fn(u64) -> f64 + Sync) -> f64 {
    let began = Instant::now();
    let done: f64 = thread::scope(|scope| {
        let work = &work;
        let all: Vec<_> = (0..threads())
            .map(|number| scope.spawn(move || work(0x9e37_79b9_7f4a_7c15 ^ number as u64)))
            .collect();
        all.into_iter().map(|thread| thread.join().unwrap_or(f64::NAN)).sum()
    });
    done / began.elapsed().as_secs_f64()
}

fn by_all_threads(count: usize, each: impl Fn(&mut Chance) + Sync) -> f64 {
    together(|seed| {
        let mut chance = Chance(seed);
        (0..count).for_each(|_| each(&mut chance));
        count as f64
    })
}

/// Bytes read and written.
fn copies() -> f64 {
    let mut buffers: Vec<(Vec<f32>, Vec<f32>)> =
        (0..threads()).map(|_| (vec![1.0; COPIED], vec![2.0; COPIED])).collect();
    let began = Instant::now();
    thread::scope(|scope| {
        for (from, to) in &mut buffers {
            scope.spawn(move || to.copy_from_slice(black_box(from)));
        }
    });
    let bytes = 2 * threads() * COPIED * size_of::<f32>();
    let seconds = began.elapsed().as_secs_f64();
    black_box(&buffers);
    bytes as f64 / seconds
}

/// Independent reads of lines that no cache holds.
fn random_lines() -> f64 {
    const READS: usize = 1 << 18;
    let words = LINE / size_of::<u64>();
    let table: Vec<u64> = (0..(TABLE / size_of::<u64>()) as u64).collect();
    together(|seed| {
        let mut chance = Chance(seed);
        let mut sum = 0u64;
        for _ in 0..READS {
            let places: [usize; AT_ONCE] =
                std::array::from_fn(|_| chance.next() as usize % (table.len() / words) * words);
            sum = places.iter().fold(sum, |sum, place| sum.wrapping_add(table[*place]));
        }
        black_box(sum);
        (READS * AT_ONCE) as f64
    })
}

/// Fused multiply-adds.
fn multiplications() -> f64 {
    const TIMES: usize = 1 << 19;
    together(|seed| {
        let mut sums = [seed as f32; SUMS];
        let (factor, term) = (black_box(0.999f32), black_box(0.001f32));
        multiply(&mut sums, factor, term, TIMES);
        black_box(&sums);
        (SUMS * TIMES) as f64
    })
}

fn multiply(sums: &mut [f32; SUMS], factor: f32, term: f32, times: usize) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: the processor has what the function asks for.
        return unsafe { multiply_wide(sums, factor, term, times) };
    }
    multiply_by(sums, factor, term, times);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn multiply_wide(sums: &mut [f32; SUMS], factor: f32, term: f32, times: usize) {
    multiply_by(sums, factor, term, times);
}

#[inline(always)]
fn multiply_by(sums: &mut [f32; SUMS], factor: f32, term: f32, times: usize) {
    // As many at a time as registers hold.
    for block in sums.as_chunks_mut::<64>().0 {
        let mut own = *block;
        for _ in 0..times {
            own = own.map(|sum| sum.mul_add(factor, term));
        }
        *block = own;
    }
}

fn shooting(scene: &Arc<PatchedScene>, seconds: f64) -> Result<f64, Failure> {
    let settings =
        ShootingSettings { resolution: RESOLUTION, seed: 1, ..ShootingSettings::default() };
    let mut device = CpuDevice::new(None)?;
    let mut shooting = device.begin(scene.clone(), &settings)?;
    shooting.iterate(2)?;
    let (began, mut shots) = (Instant::now(), 0);
    while began.elapsed().as_secs_f64() < seconds {
        shots += shooting.iterate(4)?.shots;
    }
    Ok(shots as f64 / began.elapsed().as_secs_f64())
}

/// Where the time of a picture goes.
fn stages() -> Result<Table, Failure> {
    let mut renders = Vec::new();
    for (name, glb) in [("Cornell box", made::cornell()), ("office", made::office())] {
        let request = RenderRequest {
            limits: Limits::seconds(3.0),
            ..RenderRequest::new(Arc::new(imported(&glb)), "hemilux", [500; 2])
        };
        renders.push((name, render(&mut CpuDevice::new(None)?, &request, &mut Unobserved)?));
    }
    let mut header = vec!["stage"];
    header.extend(renders.iter().map(|(name, _)| *name));
    let mut table = Table::new(&header);
    let seconds = |rendered: &Rendered, stage: &str| {
        rendered.stats.diagnostics.get(&format!("seconds_{stage}")).copied().unwrap_or(0.0)
    };
    for (stage, words) in [
        ("prepare", "hierarchies of triangles and lights"),
        ("cut", "the scene in patches"),
        ("patches", "tier 1: direct light of the patches"),
        ("shoot", "tier 1: links, and solving them"),
        ("fragments", "what the camera sees"),
        ("light", "tier 3: shadow rays"),
        ("gather", "tier 2: rays of the records"),
        ("gloss", "lobes"),
        ("smooth", "planes through the records, and between them"),
        ("picture", "the picture and its error"),
    ] {
        let mut row = vec![words.to_string()];
        row.extend(
            renders.iter().map(|(_, rendered)| {
                percent(seconds(rendered, stage) / rendered.stats.seconds_solve)
            }),
        );
        table.add(row);
    }
    Ok(table)
}
