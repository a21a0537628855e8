//! Fragments share out what a pixel sees.

use super::*;
use crate::rays::Eye;
use crate::scene::made;
use crate::transport::hemilux::specimen::{EMISSION, Specimen};

#[test]
fn the_samples_of_a_pixel_are_shared_out() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    assert_eq!(visible.start.len(), (visible.width * visible.height) as usize + 1);
    for pixel in 0..(visible.width * visible.height) as usize {
        let own =
            &visible.fragments[visible.start[pixel] as usize..visible.start[pixel + 1] as usize];
        assert!(own.iter().all(|fragment| fragment.pixel as usize == pixel));
        let share: f32 = own.iter().map(|fragment| fragment.share).sum();
        assert!((share - 1.0).abs() < 1e-5, "pixel {pixel} of a closed room sees {share}");
        assert!((visible.shine[pixel] - Rgb::splat(EMISSION)).abs().max_element() < 1e-5);
    }
}

#[test]
fn lobes_are_there_where_something_is_glossy() {
    let visible = Specimen::new(&made::phong_cornell(), 500).visible();
    let glossy = visible.fragments.iter().filter(|fragment| fragment.glossy).count();
    assert!(glossy > 0 && visible.lobes.len() >= glossy);
    assert!(visible.lobes.iter().all(|lobe| visible.fragments[lobe.fragment as usize].glossy));
    assert!(visible.lobes.is_sorted_by_key(|lobe| visible.fragments[lobe.fragment as usize].pixel));
    assert!(Specimen::furnace().visible().lobes.is_empty());
}

#[test]
fn a_fragment_is_sampled_on_all_its_facets() {
    let specimen = Specimen::new(&made::tessellated_room(20_000), 500);
    let visible = specimen.visible();
    let eye = visible.ray(0, Vec2::ZERO).0;
    let several = |fragment: &&Fragment| !fragment.has_one_facet();
    assert!(visible.fragments.iter().filter(several).count() > 50, "facets are small");
    for fragment in &visible.fragments {
        let samples = (fragment.share * visible.samples() as f32).round() as u32;
        assert_eq!(visible.count(fragment), samples);
        let points: Vec<_> = (0..samples).map(|n| visible.sample_point(fragment, n)).collect();
        for (n, point) in points.iter().enumerate() {
            assert!(!points[..n].contains(point), "sample {n} of pixel {}", fragment.pixel);
            let to = *point - eye;
            let hit = specimen.world.rays.closest(Eye::Camera, eye, to.normalize());
            let seen = hit.expect("something is there").distance / to.length();
            assert!((seen - 1.0).abs() < 1e-3, "pixel {} sees {seen} as far", fragment.pixel);
        }
    }
}
