//! Triangles in the world: counter-clockwise from the front, shading normals on the front side, no
//! degenerate triangles.

use super::document::FIX_FILE;
use super::limits::MAX_COORDINATE;
use super::local::{Local, LocalVertex};
use super::skin::{Bones, OddWeights};
use super::tangents;
use super::warnings::Warnings;
use crate::scene::{Scene, SceneError, Triangle, Vertex};
use glam::{DMat3, DMat4, DVec3, Vec3, Vec4};

/// A triangle whose area is below this, in square metres, is degenerate.
pub(super) const MIN_AREA: f64 = 1e-16;
/// A triangle whose area is below this share of its longest side's square is degenerate: its
/// height is lost in the rounding of its corners.
pub(super) const MIN_AREA_RATIO: f64 = 1e-9;

/// Least cosine between a shading normal and its triangle's own.
const MIN_NORMAL_COSINE: f32 = 1e-3;

/// A transform, with what it makes of directions.
struct Transform {
    to_world: DMat4,
    linear: DMat3,
    /// Normals are covectors. A singular transform has no inverse; its surfaces are flat.
    normal_to_world: Option<DMat3>,
    mirrored: bool,
}

impl Transform {
    /// That of a matrix.
    fn new(to_world: DMat4) -> Self {
        let linear = DMat3::from_mat4(to_world);
        let normal_to_world = Some(linear.inverse().transpose())
            .filter(|matrix| matrix.is_finite() && linear.determinant() != 0.0);
        let mirrored = linear.determinant() < 0.0;
        Self { to_world, linear, normal_to_world, mirrored }
    }

    /// A vertex in the world; `node` is named where it is too far away.
    fn apply(&self, vertex: &LocalVertex, node: usize) -> Result<Placed, SceneError> {
        let position = self.to_world.transform_point3(vertex.position);
        if !position.is_finite() || position.abs().max_element() > MAX_COORDINATE {
            return Err(SceneError::malformed(
                format!("nodes[{node}]"),
                format!("places a vertex at {position}, beyond {MAX_COORDINATE:e} m"),
                FIX_FILE,
            ));
        }
        let normal = self
            .normal_to_world
            .map_or(DVec3::ZERO, |matrix| (matrix * vertex.normal.as_dvec3()).normalize_or_zero());
        let handedness = if self.mirrored { -1.0 } else { 1.0 };
        let tangent = self.linear * vertex.tangent.truncate().as_dvec3();
        let tangent = tangent
            .try_normalize()
            .map_or(Vec4::ZERO, |tangent| tangent.as_vec3().extend(handedness * vertex.tangent.w));
        let (position, normal) = (position.as_vec3(), normal.as_vec3());
        Ok(Placed { position, normal, tangent, mirrored: self.mirrored })
    }
}

/// A vertex in the world.
struct Placed {
    position: Vec3,
    normal: Vec3,
    tangent: Vec4,
    mirrored: bool,
}

/// Where the vertices of a primitive go.
pub(super) enum Placement<'a> {
    /// All by one transform.
    Rigid(DMat4),
    /// Each by its joints.
    Skinned(Bones<'a>),
}

impl Placement<'_> {
    fn vertices(
        &self,
        local: &Local,
        node: usize,
        odd: &mut OddWeights,
    ) -> Result<Vec<Placed>, SceneError> {
        let vertices = local.vertices.iter().zip(&local.sources);
        match self {
            Self::Rigid(to_world) => {
                let transform = Transform::new(*to_world);
                vertices.map(|(vertex, _)| transform.apply(vertex, node)).collect()
            }
            Self::Skinned(bones) => vertices
                .map(|(vertex, source)| {
                    let transform = Transform::new(bones.matrix(*source as usize, odd)?);
                    transform.apply(vertex, node)
                })
                .collect(),
        }
    }
}

/// Puts the instances of a primitive into the scene and counts what is odd about them.
pub(super) struct Placing<'a> {
    /// What they are added to.
    pub scene: &'a mut Scene,
    dropped: usize,
    turned: usize,
    odd: OddWeights,
}

impl<'a> Placing<'a> {
    /// Nothing is added yet.
    pub fn new(scene: &'a mut Scene) -> Self {
        Self { scene, dropped: 0, turned: 0, odd: OddWeights::default() }
    }

    /// Adds an instance that the node of that index shows.
    pub fn add(
        &mut self,
        local: &Local,
        placement: &Placement<'_>,
        node: usize,
    ) -> Result<(), SceneError> {
        let world = placement.vertices(local, node, &mut self.odd)?;
        self.add_placed(local, &world, MIN_AREA);
        Ok(())
    }

    /// Adds it as it is in its own space, in which areas may be of any size.
    pub fn add_in_mesh_space(&mut self, local: &Local) {
        let own = |vertex: &LocalVertex| Placed {
            position: vertex.position.as_vec3(),
            normal: vertex.normal.as_dvec3().normalize_or_zero().as_vec3(),
            tangent: vertex.tangent,
            mirrored: false,
        };
        let placed: Vec<Placed> = local.vertices.iter().map(own).collect();
        self.add_placed(local, &placed, 0.0);
    }

    /// Triangles that were left out, and corners whose normals were turned.
    pub fn odd_triangles(&self) -> [usize; 2] {
        [self.dropped, self.turned]
    }

    /// Counts what was odd about a primitive that is shown so many times.
    pub fn count_odd(&mut self, [dropped, turned]: [usize; 2], times: u64) {
        let times = usize::try_from(times).unwrap_or(usize::MAX);
        self.dropped = self.dropped.saturating_add(dropped.saturating_mul(times));
        self.turned = self.turned.saturating_add(turned.saturating_mul(times));
    }

    fn add_placed(&mut self, local: &Local, world: &[Placed], least_area: f64) {
        let mut shared: Vec<Option<u32>> = vec![None; local.vertices.len()];
        for corners in &local.triangles {
            let mut corners = *corners;
            // Joints of a triangle's corners may disagree; then two of the three decide.
            if corners.iter().filter(|corner| world[**corner as usize].mirrored).count() >= 2 {
                corners.swap(1, 2);
            }
            let positions = corners.map(|corner| world[corner as usize].position);
            let Some(flat) = geometric_normal(positions, least_area) else {
                self.dropped += 1;
                continue;
            };
            let vertices = corners.map(|corner| {
                let Placed { position, normal, tangent, .. } = world[corner as usize];
                let &LocalVertex { uv, color, alpha, .. } = &local.vertices[corner as usize];
                let mut push = |normal| {
                    let index = self.scene.vertices.len() as u32;
                    let tangent = tangents::across(normal, tangent);
                    let vertex = Vertex { position, normal, uv, color, alpha, tangent };
                    self.scene.vertices.push(vertex);
                    index
                };
                // Also false for a NaN or zero normal.
                if normal.dot(flat) > MIN_NORMAL_COSINE {
                    return *shared[corner as usize].get_or_insert_with(|| push(normal));
                }
                self.turned += 1;
                push(flat)
            });
            self.scene.triangles.push(Triangle { vertices, material: local.material });
        }
    }

    /// Warns of what was odd about the instances of the primitive at that place of the file.
    pub fn warn(&self, at: &str, has_normals: bool, warnings: &mut Warnings) {
        if self.dropped > 0 {
            let what = format!("{} triangles without area are left out", self.dropped);
            warnings.push(at, what);
        }
        if self.turned > 0 && has_normals {
            warnings.push(
                format!("{at}.attributes.NORMAL"),
                format!(
                    "{} corners have no usable normal on the front side that the winding gives; the flat normal is used there",
                    self.turned
                ),
            );
        }
        let OddWeights { not_one, zero } = self.odd;
        if not_one > 0 {
            let what =
                format!("{not_one} vertices have weights that are not 1 in sum; they are scaled");
            warnings.push(format!("{at}.attributes.WEIGHTS_0"), what);
        }
        if zero > 0 {
            let what = format!(
                "{zero} vertices have no weight; they follow the first joint that they name"
            );
            warnings.push(format!("{at}.attributes.WEIGHTS_0"), what);
        }
    }
}

/// Unit normal of a triangle by its winding; `None` where it has no usable area.
fn geometric_normal(positions: [Vec3; 3], least_area: f64) -> Option<Vec3> {
    let [a, b, c] = positions.map(Vec3::as_dvec3);
    let cross = (b - a).cross(c - a);
    let area = 0.5 * cross.length();
    let longest =
        (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (area > least_area.max(MIN_AREA_RATIO * longest)).then(|| cross.normalize().as_vec3())
}
