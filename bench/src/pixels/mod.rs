//! `pixels`: independent samples, jitter and Dippé's adaptive rectangular jitter in the pixels of
//! ray-traced pictures: error against rays on three scenes, as a table of all runs (CSV), charts
//! (SVG) and the generated parts of a page.
//!
//! Two kinds of samples: `paths`, one random walk each, noisy by themselves; and `direct`, direct
//! light by many light rays each, which are nearly exact, so that edges are what is left: what
//! Dippé had in mind.

mod figures;
mod study;

use crate::cell::Pending;
use crate::results::{self, Failure};
use crate::views::{imported, regions};
use hemilux_charts::accuracy::Reference;
use hemilux_charts::regions::Regions;
use hemilux_engine::device::{self, Device};
use hemilux_engine::render::{Limits, RenderRequest, Rendered, Unobserved};
use hemilux_engine::scene::{Scene, made};
use hemilux_engine::transport::render;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use study::{CELLS, FULL, KINDS, Kind, QUICK, Results, SAMPLINGS, Sampling, Series, Size, Study};

/// Seeds of the references' halves; measured runs count from 1.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];
#[derive(clap::Args)]
pub struct Arguments {
    /// About a minute instead of five: smaller pictures, fewer seeds; writes to out/ray-tracing.
    #[arg(long)]
    quick: bool,
    /// Folder for the table and the charts; `docs/ray-tracing`, with --quick `out/ray-tracing`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Page whose generated parts are rewritten; `docs/ray-tracing.md`, none with --quick.
    #[arg(long)]
    page: Option<PathBuf>,
}

struct Bench {
    device: Box<dyn Device>,
    size: Size,
    begun: Instant,
    jobs: u64,
}

impl Bench {
    fn render(
        &mut self,
        scene: &Arc<Scene>,
        options: &[&[(&str, &str)]],
        passes: u64,
        seed: u64,
    ) -> Result<Rendered, Failure> {
        let mut request = RenderRequest {
            limits: Limits::iterations(passes),
            seed,
            // What pixels do, alone.
            options: [("pixel_samples", CELLS.to_string()), ("path_strata", "false".into())]
                .map(|(name, value)| (name.to_string(), value))
                .into(),
            ..RenderRequest::new(scene.clone(), "ray-traced", [self.size.side; 2])
        };
        for (name, value) in options.iter().copied().flatten() {
            request.options.insert((*name).into(), (*value).into());
        }
        self.jobs += 1;
        Ok(render(self.device.as_mut(), &request, &mut Unobserved)?)
    }

    fn study(
        &mut self,
        name: &'static str,
        scene: &Arc<Scene>,
        regions: &Regions,
        kind: usize,
    ) -> Result<Study, Failure> {
        let Kind { name: kind_name, options: kind_options } = KINDS[kind];
        let size = self.size;
        eprintln!("{:6.1} s  {name}, {kind_name}", self.begun.elapsed().as_secs_f64());
        let jittered = SAMPLINGS[1].options;
        let mut half = |seed| {
            self.render(scene, &[kind_options, jittered], size.reference[kind], seed)
                .map(|rendered| rendered.picture)
        };
        let reference = Reference::new(half(REFERENCE_SEEDS[0])?, half(REFERENCE_SEEDS[1])?);
        let pending = || size.samples.iter().map(|_| Pending::new(size.side)).collect::<Vec<_>>();
        let mut all: Vec<Vec<Pending>> = SAMPLINGS.iter().map(|_| pending()).collect();
        // All take turns within a seed, so that a noisy machine disturbs all alike.
        for seed in 1..=size.seeds {
            for (sampling, cells) in SAMPLINGS.iter().zip(&mut all) {
                for (samples, cell) in size.samples.iter().zip(cells) {
                    let passes = (samples / sampling.samples_of_pass).max(1);
                    let options = [kind_options, sampling.options];
                    let rendered = self.render(scene, &options, passes, seed)?;
                    cell.add(&reference, regions, rendered);
                }
            }
        }
        let finish = |(sampling, cells): (&Sampling, Vec<Pending>)| Series {
            sampling: *sampling,
            cells: cells.into_iter().map(|cell| cell.finish(&reference, regions)).collect(),
        };
        Ok(Study {
            scene: name,
            kind,
            reference_error: reference.own_error(&regions.masks[0]),
            series: SAMPLINGS.iter().zip(all).map(finish).collect(),
        })
    }
}

pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let size = if arguments.quick { QUICK } else { FULL };
    let default_out = if arguments.quick { "out/ray-tracing" } else { "docs/ray-tracing" };
    let out = arguments.out.clone().unwrap_or_else(|| default_out.into());
    let default_page = (!arguments.quick).then(|| PathBuf::from("docs/ray-tracing.md"));
    let page = arguments.page.clone().or(default_page);
    results::prepare(&out, page.as_deref())?;
    let device = device::open("cpu")?;
    let description = device.description();
    let mut bench = Bench { device, size, begun: Instant::now(), jobs: 0 };
    let mut studies = Vec::new();
    for (name, glb) in [
        ("cornell", made::cornell()),
        ("cornell_phong", made::phong_cornell()),
        ("office", made::office()),
    ] {
        let scene = Arc::new(imported(&glb));
        let regions = regions(&scene, size.side, CELLS as u32).beside_no_emitter(size.side);
        for kind in 0..KINDS.len() {
            studies.push(bench.study(name, &scene, &regions, kind)?);
        }
    }
    let results = Results {
        studies,
        size,
        quick: arguments.quick,
        device: format!("{} ({})", description.name, description.driver),
        jobs: bench.jobs,
        seconds: bench.begun.elapsed().as_secs_f64(),
        load: results::load(),
    };
    std::fs::write(out.join("pixels.csv"), figures::runs(&results).csv())?;
    for (name, text) in figures::charts(&results)? {
        std::fs::write(out.join(name), text)?;
    }
    results::publish(page.as_deref(), &figures::parts(&results))?;
    eprintln!("done: {} jobs, results in {}", bench.jobs, out.display());
    Ok(())
}
