//! Form factors F_{A→B}, the share of the power that leaves a diffuse polygon A and arrives at B,
//! by every classic route behind one interface (Rogers §5-17): closed forms, Lambert's formula
//! for a point and a polygon, Stokes' contour integral, rays, and the hemicube.
//!
//! F_{ij} means: leaves i, reaches j. A_i F_ij = A_j F_ji. All in f64; lengths in any one unit.

mod closed_forms;
mod contour;
mod hemicube;
mod point_to_polygon;
mod polygon;
mod quadrature;
mod rays;
mod route;
mod unsuitable;

pub use closed_forms::{
    ClosedForm, coaxial_disks, element_to_sphere, parallel_rectangles, perpendicular_rectangles,
    sphere_to_coaxial_disk,
};
pub use contour::Contour;
pub use hemicube::Hemicubes;
pub use point_to_polygon::{Lambert, point_to_polygon};
pub use polygon::Polygon;
pub use rays::CosineRays;
pub use route::Route;
pub use unsuitable::Unsuitable;

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn square(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        let [origin, u, v] = [origin, u, v].map(DVec3::from_array);
        Polygon::parallelogram(origin, u, v).unwrap()
    }

    /// From, to, exact value: Howell's catalogue C-11 and C-14, by closed forms, and strips of
    /// them by view-factor algebra.
    fn cases() -> Vec<(&'static str, Polygon, Polygon, f64)> {
        let floor = square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let above = |h: f64| square([0.0, 0.0, h], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
        let wall =
            |low: f64, high: f64| square([0.0, 0.0, low], [0.0, 1.0, 0.0], [0.0, 0.0, high - low]);
        vec![
            ("parallel, gap .1", floor.clone(), above(0.1), 0.826_994_522_397_257),
            ("parallel, gap 1", floor.clone(), above(1.0), 0.199_824_895_698_387),
            ("parallel, gap 10", floor.clone(), above(10.0), 0.003_162_056_838_757_6),
            ("perpendicular, common edge", floor.clone(), wall(0.0, 1.0), 0.200_043_776_075_403),
            ("perpendicular, with a gap", floor, wall(0.5, 1.5), 0.076_136_640_422_678),
        ]
    }

    #[test]
    fn every_route_gives_the_exact_values() {
        let routes: [(Box<dyn Route>, f64); 5] = [
            (Box::new(ClosedForm), 1e-12),
            (Box::new(Lambert { order: 24 }), 2e-3),
            (Box::new(Contour { order: 24 }), 1e-6),
            (Box::new(CosineRays { rays: 40_000, seed: 1 }), 8e-3),
            (Box::new(Hemicubes { resolution: 128, points: 256 }), 1e-2),
        ];
        for (name, from, to, exact) in cases() {
            for (route, tolerance) in &routes {
                let value = match route.form_factor(&from, &to, &[]) {
                    Err(Unsuitable::Configuration(_)) if name.ends_with("gap") => continue,
                    result => result.unwrap(),
                };
                // Rays and hemicubes see a small target by chance or by few pixels.
                let allowed = tolerance * (exact * exact.max(0.2)).sqrt();
                assert!(
                    (value - exact).abs() < allowed,
                    "{} on {name}: {value} instead of {exact}",
                    route.name()
                );
            }
        }
    }

    #[test]
    fn blockers_are_seen_or_refused() {
        let floor = square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let ceiling = square([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
        let screen = square([-9.0, -9.0, 0.5], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0]);
        let blockers = [screen];
        assert_eq!(
            CosineRays { rays: 1000, seed: 1 }.form_factor(&floor, &ceiling, &blockers),
            Ok(0.0)
        );
        let cubes = Hemicubes { resolution: 32, points: 4 };
        assert_eq!(cubes.form_factor(&floor, &ceiling, &blockers), Ok(0.0));
        for route in [&Contour { order: 4 } as &dyn Route, &Lambert { order: 4 }, &ClosedForm] {
            let refused = route.form_factor(&floor, &ceiling, &blockers);
            assert!(matches!(refused, Err(Unsuitable::Occlusion(_))), "{refused:?}");
        }
    }

    #[test]
    fn polygons_are_checked() {
        let corners = |list: &[[f64; 3]]| list.iter().map(|c| DVec3::from_array(*c)).collect();
        let flat = |list: &[[f64; 3]]| Polygon::new(corners(list));
        assert!(flat(&[[0.0; 3], [1.0, 0.0, 0.0]]).is_err());
        assert!(flat(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]).is_err());
        assert!(flat(&[[0.0; 3], [1.0, 0.0, 0.0], [f64::NAN, 1.0, 0.0]]).is_err());
        let bent = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]];
        assert!(flat(&bent).is_err());
        let dart = [[0.0; 3], [2.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 2.0, 0.0]];
        assert!(flat(&dart).is_err());
        assert!(flat(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).is_ok());
    }

    #[test]
    fn backs_receive_nothing() {
        let floor = square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let away = square([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        for route in [
            &Contour { order: 8 } as &dyn Route,
            &Lambert { order: 8 },
            &CosineRays { rays: 100, seed: 1 },
            &Hemicubes { resolution: 32, points: 1 },
        ] {
            assert_eq!(route.form_factor(&floor, &away, &[]), Ok(0.0), "{}", route.name());
        }
    }
}
