//! What a camera looks at: patches are finest about it, and the coarser the farther away they are, so
//! that a wide plain takes no patches from the house on it that is seen.

use crate::scene::{Scene, Triangle};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Most bisections of a triangle one within the other.
const MOST_BISECTIONS: u32 = 64;
/// Most pieces of a triangle.
const MOST_PIECES: usize = 4096;
/// Triangles of a parallel task.
const CHUNK: usize = 1 << 14;

/// A ball about what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Its centre, world space.
    pub center: Vec3,
    /// Its radius, metres, above 0.
    pub radius: f32,
}

impl Focus {
    /// How many times as long a patch may be as one in the ball.
    pub fn scale_at(&self, point: Vec3) -> f32 {
        (point.distance(self.center) / self.radius).max(1.0)
    }

    /// How much of an area counts.
    pub fn weight(&self, point: Vec3) -> f32 {
        let scale = self.scale_at(point);
        1.0 / (scale * scale)
    }

    /// The same of a triangle's, which is not too large.
    pub fn weight_of(&self, [a, b, c]: [Vec3; 3]) -> f32 {
        self.weight((a + b + c) / 3.0)
    }

    /// Whether a triangle is longer than the ball's radius and than it is far away, so that distances
    /// differ over it.
    pub fn is_too_large(&self, [a, b, c]: [Vec3; 3]) -> bool {
        let most = self.radius * self.scale_at((a + b + c) / 3.0);
        let longest = (b - a).length_squared().max((c - b).length_squared());
        longest.max((a - c).length_squared()) > most * most
    }

    /// The area of a triangle that counts.
    pub fn counted(&self, corners: [Vec3; 3]) -> f64 {
        let counted = |corners| f64::from(area_of(corners) * self.weight_of(corners));
        if !self.is_too_large(corners) {
            return counted(corners);
        }
        let pieces = pieces_of(corners, |piece| self.is_too_large(piece));
        pieces.into_iter().map(|(piece, _)| counted(piece)).sum()
    }

    /// The share of a scene's area that counts.
    pub fn share(&self, scene: &Scene) -> f64 {
        let of_chunk = |triangles: &[Triangle]| {
            let (mut counted, mut all) = (0f64, 0f64);
            for triangle in triangles {
                let corners = scene.corners(triangle);
                all += f64::from(area_of(corners));
                counted += self.counted(corners);
            }
            (counted, all)
        };
        let mut sums: Vec<(f64, f64)> = scene.triangles.par_chunks(CHUNK).map(of_chunk).collect();
        // An instance is taken to be all in one place.
        sums.extend(
            scene
                .instance_areas(|_| 1.0)
                .map(|(middle, area)| (area * f64::from(self.weight(middle)), area)),
        );
        let counted: f64 = sums.iter().map(|sum| sum.0).sum();
        counted / sums.iter().map(|sum| sum.1).sum::<f64>().max(f64::MIN_POSITIVE)
    }
}

/// Area of a triangle.
pub fn area_of([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

/// A piece of a triangle: its corners, and their barycentric (u, v) in the whole.
pub type Piece = ([Vec3; 3], [Vec2; 3]);

/// The pieces of a triangle that is bisected at the longest edge, and the halves again, while they are
/// `too_large`.
pub fn pieces_of(corners: [Vec3; 3], too_large: impl Fn([Vec3; 3]) -> bool) -> Vec<Piece> {
    let mut open = vec![((corners, [Vec2::ZERO, Vec2::X, Vec2::Y]), 0)];
    let mut pieces = Vec::new();
    while let Some((piece, bisections)) = open.pop() {
        let many = pieces.len() + open.len() >= MOST_PIECES;
        if many || bisections == MOST_BISECTIONS || !too_large(piece.0) {
            pieces.push(piece);
        } else {
            let [first, second] = halves(piece);
            open.extend([(second, bisections + 1), (first, bisections + 1)]);
        }
    }
    pieces
}

/// Both sides of the line from the middle of the longest edge to the corner opposite.
fn halves((corners, at): Piece) -> [Piece; 2] {
    let length = |edge: usize| corners[edge].distance_squared(corners[(edge + 1) % 3]);
    let longest =
        (1..3).fold(0, |best, edge| if length(edge) > length(best) { edge } else { best });
    let [p, q, r] = [longest, (longest + 1) % 3, (longest + 2) % 3];
    let (middle, middle_at) = (0.5 * (corners[p] + corners[q]), 0.5 * (at[p] + at[q]));
    [
        ([corners[p], middle, corners[r]], [at[p], middle_at, at[r]]),
        ([middle, corners[q], corners[r]], [middle_at, at[q], at[r]]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometry::Rgb;
    use crate::scene::{Material, Vertex};

    fn plain(side: f32) -> Scene {
        let corner = |x: f32, y: f32| Vertex::new(Vec3::new(x, y, 0.0) * side, Vec3::Z);
        Scene {
            vertices: vec![
                corner(-0.5, -0.5),
                corner(0.5, -0.5),
                corner(0.5, 0.5),
                corner(-0.5, 0.5),
            ],
            triangles: [[0, 1, 2], [0, 2, 3]]
                .map(|vertices| Triangle { vertices, material: 0 })
                .into(),
            materials: vec![Material::lambertian("grey", Rgb::splat(0.5))],
            ..Scene::default()
        }
    }

    /// Over a plain much wider than the ball, the area that counts is that of the ball and, around it,
    /// ∫ 2πr (R/r)² dr from R to the edge.
    #[test]
    fn what_is_far_away_counts_little() {
        let focus = Focus { center: Vec3::ZERO, radius: 10.0 };
        assert!((focus.share(&plain(10.0)) - 1.0).abs() < 1e-3);
        let side = 1000f64;
        let expected = 100.0 * std::f64::consts::PI * (1.0 + 2.0 * (0.56 * side / 10.0).ln());
        let found = focus.share(&plain(side as f32)) * side * side;
        assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
    }

    #[test]
    fn pieces_fill_the_triangle_and_none_is_too_large() {
        let focus = Focus { center: Vec3::new(3.0, 1.0, 0.0), radius: 2.0 };
        let scene = plain(1e4);
        for triangle in &scene.triangles {
            let corners = scene.corners(triangle);
            let pieces = pieces_of(corners, |piece| focus.is_too_large(piece));
            assert!(pieces.len() > 30 && pieces.len() < 400, "{}", pieces.len());
            let area: f32 = pieces.iter().map(|piece| area_of(piece.0)).sum();
            assert!((area / area_of(corners) - 1.0).abs() < 1e-3);
            for (corners, at) in pieces {
                assert!(!focus.is_too_large(corners));
                for (corner, at) in corners.into_iter().zip(at) {
                    let place = scene.interpolate(triangle, at.x, at.y, |vertex| vertex.position);
                    assert!(place.distance(corner) < 1e-2);
                }
            }
        }
    }
}
