use super::beginning::Kept;
use crate::checkpoint::Checkpoint;
use crate::device::cpu::CpuDevice;
use crate::image::Picture;
use crate::radiometry::Rgb;
use crate::render::{
    Begin, CameraChoice, ExplicitCamera, Limits, Observer, Progress, RenderRequest, Unobserved,
};
use crate::scene::environment::{Environment, Sky};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::{Triangle, Vertex, made};
use crate::transport::{Prepared, render, render_prepared};
use glam::Vec3;
use std::sync::Arc;

fn picture(glb: &[u8], threads: usize, seed: u64) -> Picture {
    rendered(request(glb, seed, 1.0), threads)
}

/// The picture with all lights so many times as bright.
fn lit_picture(glb: &[u8], threads: usize, seed: u64, brightness: f32) -> Picture {
    rendered(request(glb, seed, brightness), threads)
}

fn request(glb: &[u8], seed: u64, brightness: f32) -> RenderRequest {
    let mut scene = import(glb, &Resources::default(), &ImportLimits::default()).unwrap();
    scene.materials.iter_mut().for_each(|material| material.emission *= brightness);
    RenderRequest {
        environment: Some(Arc::new(Environment::none())),
        limits: Limits::iterations(4),
        seed,
        ..RenderRequest::new(Arc::new(scene), "hemilux", [70, 50])
    }
}

fn rendered(request: RenderRequest, threads: usize) -> Picture {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut device = CpuDevice::new(Some(threads)).unwrap();
    let rendered = pool.install(|| render(&mut device, &request, &mut Unobserved)).unwrap();
    rendered.picture
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    for glb in [made::cornell(), made::phong_cornell()] {
        let alone = picture(&glb, 1, 5);
        assert_eq!(alone, picture(&glb, 3, 5));
        assert_ne!(alone, picture(&glb, 3, 6), "the seed does nothing");
    }
}

/// A room of some 40,000 triangles, for which so many patches are wanted.
fn room(patches: usize) -> RenderRequest {
    let options = [("coarse_patches".to_owned(), patches.to_string())].into();
    let limits = Limits::iterations(2);
    RenderRequest { options, limits, ..request(&made::tessellated_room(40_000), 5, 1.0) }
}

#[test]
fn the_bits_of_a_crowd_do_not_depend_on_the_threads() {
    assert_eq!(rendered(room(1000), 1), rendered(room(1000), 3));
}

/// Keeps what a job knows at its end.
#[derive(Default)]
struct Keeper(Option<Arc<Checkpoint>>);

impl Observer for Keeper {
    fn wants_solution(&mut self, _: &Progress) -> bool {
        true
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        self.0 = Some(Arc::new(checkpoint));
    }
}

/// On a plain so wide that patches are finest about what the camera sees.
#[test]
fn a_crowd_on_a_plain_goes_on_as_if_it_had_never_stopped() {
    let mut whole = room(1000);
    let scene = Arc::make_mut(&mut whole.scene);
    let first = scene.vertices.len() as u32;
    for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)] {
        scene.vertices.push(Vertex::new(Vec3::new(1e3 * x, -0.5, 1e3 * z), Vec3::Y));
    }
    for corners in [[0, 1, 2], [0, 2, 3]] {
        let vertices = corners.map(|corner| first + corner);
        scene.triangles.push(Triangle { vertices, material: 0 });
    }
    let mut device = CpuDevice::new(Some(2)).unwrap();
    let begun = Limits::iterations(1);
    let half = RenderRequest { limits: begun, ..whole.clone() };
    let mut keeper = Keeper::default();
    render(&mut device, &half, &mut keeper).unwrap();
    let kept = keeper.0.expect("a solution was wanted");
    let begin = Begin::Continue(kept);
    let gone_on = rendered(RenderRequest { begin, ..whole.clone() }, 2);
    assert_eq!(gone_on, rendered(whole, 2));
}

/// A crowd of triangles looks as the same triangles do when all of them are listed.
#[test]
fn crowds_are_lit_as_others_are() {
    let [crowd, listed] = [1000, 12_000].map(|patches| rendered(room(patches), 2));
    let mean = |picture: &Picture| picture.pixels.iter().sum::<Rgb>() / picture.pixels.len() as f32;
    let ratio = mean(&crowd) / mean(&listed);
    assert!((ratio - Rgb::ONE).abs().max_element() < 0.01, "{ratio}");
    let differences = crowd.pixels.iter().zip(&listed.pixels);
    let squares: f32 = differences.map(|(a, b)| (*a - *b).length_squared()).sum();
    let off =
        (squares / (3 * crowd.pixels.len()) as f32).sqrt() / mean(&listed).element_sum() * 3.0;
    assert!(off < 0.03, "{off}");
}

/// Light is linear: nothing may compare or mix radiance with numbers of another unit.
#[test]
fn a_thousandth_of_the_light_makes_a_thousandth_of_the_picture() {
    for glb in [made::cornell(), made::phong_cornell()] {
        let bright = lit_picture(&glb, 2, 5, 1.0);
        let dim = lit_picture(&glb, 2, 5, 1.0 / 1024.0);
        let worst = bright
            .pixels
            .iter()
            .zip(&dim.pixels)
            .map(|(bright, dim)| {
                (*bright - *dim * 1024.0).abs().max_element() / bright.max_element()
            })
            .fold(0.0, f32::max);
        assert!(worst < 1e-3, "{worst}");
    }
}

/// A picture by what other jobs have made of its scene.
fn prepared_picture(request: &RenderRequest, prepared: &Prepared) -> Picture {
    let mut device = CpuDevice::new(Some(2)).unwrap();
    render_prepared(&mut device, request, prepared, &mut Unobserved).unwrap().picture
}

/// Jobs on a scene begin with what the one before has left, where they would find the same; whether
/// they do or not, their pictures are those of jobs that begin with nothing.
#[test]
fn what_a_job_begins_with_is_for_jobs_that_would_find_the_same() {
    let first = RenderRequest { width: 30, height: 20, ..request(&made::cornell(), 5, 1.0) };
    let elsewhere = ExplicitCamera {
        eye: [0.4, 1.2, 3.2],
        target: [0.0, 1.0, 0.0],
        up: [0.0, 1.0, 0.0],
        yfov_degrees: 40.0,
    };
    let set = |key: &str, value: &str| [(key.to_owned(), value.to_owned())].into();
    let sky = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::none() };
    let camera = CameraChoice::Explicit(elsewhere);
    let brighter = Environment { sky: Sky::Uniform(Rgb::splat(2.0)), ..Environment::none() };
    let others = [
        (true, RenderRequest { camera, ..first.clone() }),
        (true, RenderRequest { width: 25, ..first.clone() }),
        (false, RenderRequest { seed: 6, ..first.clone() }),
        (false, RenderRequest { environment: Some(Arc::new(sky)), ..first.clone() }),
        (false, RenderRequest { environment: Some(Arc::new(brighter)), ..first.clone() }),
        (false, RenderRequest { options: set("coarse_patches", "300"), ..first.clone() }),
        (false, RenderRequest { options: set("near_field", "false"), ..first.clone() }),
        (false, RenderRequest { options: set("coarse_rays", "8"), ..first.clone() }),
    ];
    let prepared = Prepared::new(first.scene.clone());
    prepared_picture(&first, &prepared);
    for (index, (is_same, other)) in others.iter().enumerate() {
        prepared_picture(&first, &prepared);
        let kept = prepared.beginning::<Kept>().expect("the first has left one");
        let shown = prepared_picture(other, &prepared);
        let now = prepared.beginning::<Kept>().expect("one of them has left one");
        assert_eq!(Arc::ptr_eq(&kept, &now), *is_same, "request {index}");
        let afresh = prepared_picture(other, &Prepared::new(first.scene.clone()));
        assert!(shown == afresh, "request {index} shows something else");
    }
}

/// Diffuse light takes rays where something reflects it: none go out from metal.
#[test]
fn metal_asks_for_no_diffuse_light() {
    let mut request = request(&made::cornell(), 5, 1.0);
    let figures = |request: &RenderRequest| {
        let mut device = CpuDevice::new(None).unwrap();
        let rendered = render(&mut device, request, &mut Unobserved).unwrap();
        let of = |name: &str| rendered.stats.diagnostics[name];
        [of("records"), of("shadow_rays"), of("lobe_rays")]
    };
    let [records, shadow_rays, lobe_rays] = figures(&request);
    assert!(records > 0.0 && shadow_rays > 0.0 && lobe_rays == 0.0);
    let scene = Arc::make_mut(&mut request.scene);
    for material in &mut scene.materials {
        (material.metallic, material.roughness) = (1.0, 0.3);
    }
    let [records, shadow_rays, lobe_rays] = figures(&request);
    assert_eq!([records, shadow_rays], [0.0; 2]);
    assert!(lobe_rays > 0.0);
}
