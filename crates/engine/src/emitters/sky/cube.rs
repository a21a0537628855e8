//! Directions on the faces of a cube: a grid over all directions without crowded poles.

use glam::Vec3;

/// Where a direction meets the surface of the cube [−1, 1]³.
#[derive(Clone, Copy, Debug)]
pub struct OnCube {
    /// 0 … 5: axis of the face, then its side.
    pub face: usize,
    /// Both coordinates across the face, in [−1, 1].
    pub at: [f32; 2],
    /// The point itself.
    pub point: Vec3,
    /// The direction's length over the point's.
    pub length: f32,
}

impl OnCube {
    /// Of a direction other than zero.
    pub fn new(direction: Vec3) -> Self {
        let size = direction.abs();
        let axis = match () {
            () if size.x >= size.y && size.x >= size.z => 0,
            () if size.y >= size.z => 1,
            () => 2,
        };
        let length = size[axis];
        let point = direction / length;
        let face = 2 * axis + usize::from(direction[axis] < 0.0);
        Self { face, at: [point[(axis + 1) % 3], point[(axis + 2) % 3]], point, length }
    }
}

/// The point of a face's coordinates.
pub fn point(face: usize, [a, b]: [f32; 2]) -> Vec3 {
    let axis = face / 2;
    let mut point = Vec3::ZERO;
    point[axis] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    point[(axis + 1) % 3] = a;
    point[(axis + 2) % 3] = b;
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_found_again() {
        for face in 0..6 {
            for at in [[0.0, 0.0], [0.9, -0.3], [-0.99, 0.5]] {
                let on = OnCube::new(point(face, at) * 0.5);
                assert_eq!((on.face, on.at, on.length), (face, at, 0.5));
                assert_eq!(on.point, point(face, at));
            }
        }
    }
}
