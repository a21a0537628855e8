use crate::device::cpu::CpuDevice;
use crate::image::Picture;
use crate::render::{CameraChoice, Limits, RenderRequest, Unobserved};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made;
use crate::transport::render;
use std::sync::Arc;

fn picture(glb: &[u8], threads: usize, seed: u64) -> Picture {
    lit_picture(glb, threads, seed, 1.0)
}

/// The picture with all lights so many times as bright.
fn lit_picture(glb: &[u8], threads: usize, seed: u64, brightness: f32) -> Picture {
    let mut scene = import(glb, &Resources::default(), &ImportLimits::default()).unwrap();
    scene.materials.iter_mut().for_each(|material| material.emission *= brightness);
    let request = RenderRequest {
        scene: Arc::new(scene),
        environment: None,
        background: Default::default(),
        camera: CameraChoice::First,
        width: 70,
        height: 50,
        method: "hemilux".into(),
        limits: Limits { iterations: Some(4), ..Limits::default() },
        seed,
        options: Default::default(),
        begin: Default::default(),
    };
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
