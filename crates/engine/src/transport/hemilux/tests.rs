use super::Hemilux;
use crate::device::cpu::CpuDevice;
use crate::image::Picture;
use crate::render::{CameraChoice, Limits, RenderRequest, Unobserved};
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::made;
use crate::transport::Method;
use std::sync::Arc;

fn picture(glb: &[u8], threads: usize, seed: u64, solver: &str) -> Picture {
    let scene = import(glb, &Resources::default(), &ImportLimits::default()).unwrap();
    let request = RenderRequest {
        scene: Arc::new(scene),
        camera: CameraChoice::First,
        width: 70,
        height: 50,
        method: "hemilux".into(),
        limits: Limits { iterations: Some(4), ..Limits::default() },
        seed,
        options: [("coarse_solver".to_string(), solver.to_string())].into(),
        begin: Default::default(),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut device = CpuDevice::new(Some(threads)).unwrap();
    let rendered = pool
        .install(|| Hemilux.render(&mut device, &request, Vec::new(), &mut Unobserved))
        .unwrap();
    rendered.picture
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    for (glb, solver) in
        [(made::cornell(), "links"), (made::cornell(), "shots"), (made::phong_cornell(), "links")]
    {
        let alone = picture(&glb, 1, 5, solver);
        assert_eq!(alone, picture(&glb, 3, 5, solver));
        assert_ne!(alone, picture(&glb, 3, 6, solver), "the seed does nothing");
    }
}
