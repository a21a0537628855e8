//! Checkpoints whose sums are right and whose contents are not.

use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::device::cpu::CpuDevice;
use crate::random::{Numbers, Stream};
use crate::render::{Begin, Limits, Observer, Progress, RenderError, RenderRequest};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made;
use crate::transport::render;
use std::sync::Arc;

/// Takes the solution.
#[derive(Default)]
struct Taker(Option<Checkpoint>);

impl Observer for Taker {
    fn wants_solution(&mut self, _progress: &Progress) -> bool {
        true
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        self.0 = Some(checkpoint);
    }
}

fn request(method: &str, iterations: u64) -> RenderRequest {
    let scene = match method {
        "illumination-map" => made::ring(),
        "stochastic" => made::phong_cornell(),
        _ => made::cornell(),
    };
    let scene = import(&scene, &Resources::new(), &ImportLimits::default()).expect("valid");
    let options = match method {
        "ray-traced" => vec![],
        "illumination-map" => vec![("map_texels", "500"), ("light_rays", "64")],
        "hemilux" => vec![("coarse_patches", "60"), ("coarse_rays", "4"), ("gather_rays", "4")],
        _ => vec![("patches", "60"), ("hemicube_resolution", "16")],
    };
    let options = options.into_iter().map(|(name, value)| (name.into(), value.into()));
    RenderRequest {
        limits: Limits::iterations(iterations),
        options: options.collect(),
        ..RenderRequest::new(Arc::new(scene), method, [10, 8])
    }
}

/// A checkpoint of a short run of the method.
fn taken(method: &str) -> Checkpoint {
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    let mut taker = Taker::default();
    render(&mut device, &request(method, 3), &mut taker).expect("renders");
    taker.0.expect("a solution")
}

fn go_on(method: &str, checkpoint: Checkpoint) -> Result<crate::image::Picture, RenderError> {
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    let begin = Begin::Continue(Arc::new(checkpoint));
    let request = RenderRequest { begin, ..request(method, 6) };
    render(&mut device, &request, &mut Taker(None)).map(|rendered| rendered.picture)
}

/// The version of the program is no reason to refuse a checkpoint; the method's format is.
#[test]
fn checkpoints_outlive_versions_and_other_formats_are_refused_by_name() {
    for method in super::super::METHODS.iter().filter(|method| **method != "auto") {
        let mut device = CpuDevice::new(Some(1)).expect("threads");
        let whole = render(&mut device, &request(method, 6), &mut Taker(None)).expect("renders");
        // The first release wrote no format, knew fewer settings, wrote those of all methods, and had
        // a number where hemilux goes by the limits.
        let old = taken(method).with_header_changed(|header| {
            header.insert("engine".into(), "0.0.7".into());
            header.remove("format").expect("a format");
            let settings = header["settings"].as_object_mut().expect("settings");
            for name in super::OF_ALL_METHODS {
                settings.entry(name).or_insert_with(|| "default".into());
            }
            settings.remove("path_strata");
            if *method == "hemilux" {
                settings.insert("pixel_samples".into(), "16".into());
            }
        });
        let format = match *method {
            "hemilux" => 29,
            "ray-traced" | "illumination-map" => 2,
            _ => 3,
        };
        let told = go_on(method, old).expect_err("of another format").to_string();
        let reads = format!("reads format {format}");
        assert!(told.contains("format 1") && told.contains(&reads), "{told}");
        let other_version = taken(method).with_header_changed(|header| {
            header.insert("engine".into(), "0.0.7".into());
        });
        let picture = go_on(method, other_version).expect("it goes on");
        assert!(picture == whole.picture, "{method}: not the same bits");
        let later = taken(method).with_header_changed(|header| {
            header.insert("engine".into(), "0.0.7".into());
            header.insert("format".into(), 99.into());
        });
        let told = go_on(method, later).expect_err("refused").to_string();
        for part in ["format 99", method, "0.0.7", &format!("reads format {format}")] {
            assert!(told.contains(part), "{told}");
        }
        let other = taken(method).with_header_changed(|header| {
            let (name, value) = match *method {
                "ray-traced" | "illumination-map" => ("ray_preset", "lange"),
                "hemilux" => ("pixel_samples", "9"),
                _ => ("hemicube_resolution", "18"),
            };
            header["settings"][name] = value.into();
        });
        let told = go_on(method, other).expect_err("refused").to_string();
        assert!(told.contains("not to "), "{told}");
        let strange = taken(method).with_header_changed(|header| {
            header["settings"]["flux_capacitor"] = "on".into();
        });
        let told = go_on(method, strange).expect_err("refused").to_string();
        assert!(told.contains("flux_capacitor"), "{told}");
    }
}

/// A job that begins with anything whatever ends with a picture or an error: no panic, no endless
/// loop, no memory beyond that of an honest one.
#[test]
fn contents_that_lie_do_no_harm() {
    let mut device = CpuDevice::new(Some(1)).expect("threads");
    let mut numbers = Numbers::new(1, Stream::Gather, 0);
    for method in super::super::METHODS.iter().filter(|method| **method != "auto") {
        let mut taker = Taker::default();
        render(&mut device, &request(method, 3), &mut taker).expect("renders");
        let honest = taker.0.expect("a solution");
        let (mut refused, mut rendered) = (0, 0);
        for turn in 0..120 {
            let mut parts = honest.clone().into_parts();
            let part = if turn % 3 == 2 { &mut parts.2 } else { &mut parts.1 };
            if part.is_empty() {
                continue;
            }
            let at = (numbers.fine() * part.len() as f64) as usize;
            match turn % 4 {
                // Lengths and counts are at the front.
                0 => {
                    let front = at % part.len().min(64);
                    part[front] ^= 1 << (turn % 8);
                }
                1 => part.truncate(at),
                2 => part[at] ^= 0xff,
                _ => {
                    let end = part.len().min(at + 4);
                    part[at..end].fill(0xff);
                }
            }
            let changed = Arc::new(Checkpoint::new(parts.0, parts.1, parts.2));
            let begin = match turn % 2 {
                0 => Begin::Continue(changed),
                _ => Begin::View(changed),
            };
            match render(
                &mut device,
                &RenderRequest { begin, ..request(method, 4) },
                &mut Taker(None),
            ) {
                Err(RenderError::Checkpoint(CheckpointError::Damaged { .. })) => refused += 1,
                Err(RenderError::Checkpoint(CheckpointError::Foreign { .. })) => refused += 1,
                Err(other) => panic!("{method}: {other}"),
                Ok(_) => rendered += 1,
            }
        }
        println!("{method}: {refused} refused, {rendered} rendered");
        assert!(refused > 5, "{method}: {refused} of {}", refused + rendered);
    }
}
