//! A mesh's primitives: how their vertices join, and which accessors they are read from.

use super::accessor::Accessor;
use super::document::{MoreTargets, malformed, valid};
use super::morph;
use super::variants::Variants;
use super::warnings::Warnings;
use crate::scene::SceneError;
use gltf::Semantic;
use gltf::json;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;

/// Most sets of four joints of a vertex.
const MAX_SETS: u32 = 8;

/// How vertices join to triangles.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Mode {
    /// Three to a triangle.
    List,
    /// Each with the two before it.
    Strip,
    /// Each with the one before it and the first.
    Fan,
}

impl Mode {
    /// Triangles that `count` vertices make.
    fn triangles(self, count: usize) -> usize {
        match self {
            Mode::List => count / 3,
            Mode::Strip | Mode::Fan => count.saturating_sub(2),
        }
    }

    /// Places of a triangle's corners in the vertex order.
    pub fn corners(self, triangle: usize) -> [usize; 3] {
        match self {
            Mode::List => [3 * triangle, 3 * triangle + 1, 3 * triangle + 2],
            Mode::Strip if triangle % 2 == 1 => [triangle + 1, triangle, triangle + 2],
            Mode::Strip => [triangle, triangle + 1, triangle + 2],
            Mode::Fan => [triangle + 1, triangle + 2, 0],
        }
    }
}

/// A primitive that makes triangles.
pub(super) struct Primitive {
    /// Its place in the file.
    pub at: String,
    /// How its vertices join.
    pub mode: Mode,
    /// Accessor of positions, and of what else its vertices have.
    pub position: usize,
    /// Of normals.
    pub normal: Option<usize>,
    /// Of tangents.
    pub tangent: Option<usize>,
    /// Of texture coordinate sets 0 and 1.
    pub uv: [Option<usize>; 2],
    /// Of vertex colours.
    pub color: Option<usize>,
    /// Of joints and of their weights, set by set; empty without.
    pub influences: Vec<(usize, usize)>,
    /// Its morph targets.
    pub targets: Vec<morph::Target>,
    /// Of vertex indices; without them the vertices are used in turn.
    pub indices: Option<usize>,
    /// Its material in the chosen variant.
    pub material: Option<usize>,
    /// How many triangles it makes.
    pub triangles: usize,
}

/// What primitives of all meshes are read with.
#[derive(Clone, Copy)]
pub(super) struct Tables<'a> {
    /// The file's accessors.
    pub accessors: &'a [Accessor<'a>],
    /// Its variants.
    pub variants: &'a Variants,
    /// What the crate does not know of its morph targets.
    pub more_targets: &'a MoreTargets,
}

/// The primitives of a mesh that make triangles.
pub(super) fn primitives(
    mesh: &json::Mesh,
    index: usize,
    tables: Tables<'_>,
    warnings: &mut Warnings,
) -> Result<Vec<Primitive>, SceneError> {
    let mut primitives = Vec::new();
    for (place, object) in mesh.primitives.iter().enumerate() {
        let at = format!("meshes[{index}].primitives[{place}]");
        primitives.extend(primitive(object, (at, (index, place)), tables, warnings)?);
    }
    Ok(primitives)
}

fn primitive(
    object: &json::mesh::Primitive,
    (at, of): (String, (usize, usize)),
    Tables { accessors, variants, more_targets }: Tables<'_>,
    warnings: &mut Warnings,
) -> Result<Option<Primitive>, SceneError> {
    let mut attributes = Attributes::of(object, &at, accessors)?;
    if object.attributes.contains_key(&Checked::Invalid) {
        warnings.push(
            &attributes.at,
            "a name that glTF does not define is ignored; names of your own begin with _",
        );
    }
    let indices = indices(object, &at, accessors)?;
    let material = variants.material(object, &at)?;
    let Some(mode) = mode(object, &at, warnings)? else { return Ok(None) };
    let Some(position) = attributes.position else {
        let what = "is missing; the primitive is left out";
        warnings.push(format!("{}.POSITION", attributes.at), what);
        return Ok(None);
    };
    let vertices = accessors[position].count;
    attributes.check_counts(vertices, accessors, warnings)?;
    let morphs = morph::Place { at: &at, of, accessors, more: more_targets };
    let targets = morphs.targets(object, vertices)?;
    let count = indices.map_or(vertices, |index| accessors[index].count);
    if mode == Mode::List && !count.is_multiple_of(3) {
        warnings.push(
            &at,
            format!("{count} corners make no whole number of triangles; the rest is left out"),
        );
    }
    let triangles = mode.triangles(count);
    let Attributes { normal, tangent, uv, color, influences, .. } = attributes;
    Ok(Some(Primitive {
        at,
        mode,
        position,
        normal,
        tangent,
        uv,
        color,
        influences,
        targets,
        indices,
        material,
        triangles,
    }))
}

/// Which accessors a primitive's vertices are read from.
struct Attributes {
    /// Their place in the file.
    at: String,
    position: Option<usize>,
    normal: Option<usize>,
    tangent: Option<usize>,
    uv: [Option<usize>; 2],
    color: Option<usize>,
    influences: Vec<(usize, usize)>,
}

impl Attributes {
    fn of(
        object: &json::mesh::Primitive,
        at: &str,
        accessors: &[Accessor<'_>],
    ) -> Result<Self, SceneError> {
        use ComponentType::{F32, I8, I16, U8, U16};
        const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
        let at = format!("{at}.attributes");
        let attribute = |semantic: Semantic, kinds: &[Type], components: &[ComponentType]| {
            let name = semantic.to_string();
            let Some(index) = object.attributes.get(&Checked::Valid(semantic)) else {
                return Ok(None);
            };
            let accessor = &accessors[index.value()];
            if !kinds.contains(&accessor.kind) || !components.contains(&accessor.component) {
                return Err(malformed(
                    format!("{at}.{name}"),
                    format!("{} is {:?} of {:?}", accessor.at, accessor.kind, accessor.component),
                ));
            }
            Ok(Some(index.value()))
        };
        let mut influences = Vec::new();
        for set in 0.. {
            let joints = attribute(Semantic::Joints(set), &[Type::Vec4], &[U8, U16])?;
            let weights = attribute(Semantic::Weights(set), &[Type::Vec4], &[F32, U8, U16])?;
            match (joints, weights) {
                (None, None) => break,
                _ if set == MAX_SETS => {
                    let what = format!("more than {MAX_SETS} sets of joints");
                    return Err(SceneError::too_large(at, what, "limit the joints of a vertex"));
                }
                (Some(joints), Some(weights)) => influences.push((joints, weights)),
                (joints, _) => {
                    let there = if joints.is_some() { "JOINTS" } else { "WEIGHTS" };
                    let missing = if joints.is_some() { "WEIGHTS" } else { "JOINTS" };
                    let what = format!("has {there}_{set}, but no {missing}_{set}");
                    return Err(malformed(at, what));
                }
            }
        }
        Ok(Self {
            influences,
            position: attribute(Semantic::Positions, &[Type::Vec3], QUANTIZED)?,
            normal: attribute(Semantic::Normals, &[Type::Vec3], &[F32, I8, I16])?,
            tangent: attribute(Semantic::Tangents, &[Type::Vec4], &[F32, I8, I16])?,
            uv: [
                attribute(Semantic::TexCoords(0), &[Type::Vec2], QUANTIZED)?,
                attribute(Semantic::TexCoords(1), &[Type::Vec2], QUANTIZED)?,
            ],
            color: attribute(Semantic::Colors(0), &[Type::Vec3, Type::Vec4], &[F32, U8, U16])?,
            at,
        })
    }

    /// Refuses joints and weights that have not one element for each position, and leaves out other
    /// such attributes with a warning: without them the shape is still there.
    fn check_counts(
        &mut self,
        vertices: usize,
        accessors: &[Accessor<'_>],
        warnings: &mut Warnings,
    ) -> Result<(), SceneError> {
        let [uv_0, uv_1] = &mut self.uv;
        for (set, (joints, weights)) in self.influences.iter().enumerate() {
            for (name, index) in [("JOINTS", joints), ("WEIGHTS", weights)] {
                let count = accessors[*index].count;
                if count != vertices {
                    return Err(malformed(
                        format!("{}.{name}_{set}", self.at),
                        format!("has {count} elements for {vertices} positions"),
                    ));
                }
            }
        }
        for (name, index) in [
            ("NORMAL", &mut self.normal),
            ("TANGENT", &mut self.tangent),
            ("TEXCOORD_0", uv_0),
            ("TEXCOORD_1", uv_1),
            ("COLOR_0", &mut self.color),
        ] {
            let count = index.map(|index| accessors[index].count);
            if let Some(count) = count.filter(|count| *count != vertices) {
                *index = None;
                warnings.push(
                    format!("{}.{name}", self.at),
                    format!(
                        "has {count} elements for {vertices} positions; it is ignored, export the mesh again to have it"
                    ),
                );
            }
        }
        Ok(())
    }
}

/// The accessor of a primitive's vertex indices.
fn indices(
    object: &json::mesh::Primitive,
    at: &str,
    accessors: &[Accessor<'_>],
) -> Result<Option<usize>, SceneError> {
    let indices = object.indices.map(|index| index.value());
    if let Some(accessor) = indices.map(|index| &accessors[index])
        && !accessor.is_index()
    {
        return Err(malformed(
            format!("{at}.indices"),
            format!("{} is not a list of unsigned integers", accessor.at),
        ));
    }
    Ok(indices)
}

/// How a primitive's vertices join; `None` where they make no triangles.
fn mode(
    object: &json::mesh::Primitive,
    at: &str,
    warnings: &mut Warnings,
) -> Result<Option<Mode>, SceneError> {
    Ok(match valid(&object.mode, format!("{at}.mode"))? {
        json::mesh::Mode::Triangles => Some(Mode::List),
        json::mesh::Mode::TriangleStrip => Some(Mode::Strip),
        json::mesh::Mode::TriangleFan => Some(Mode::Fan),
        mode => {
            let what = if mode == json::mesh::Mode::Points { "points" } else { "lines" };
            warnings.push(format!("{at}.mode"), format!("{what} have no area; they are left out"));
            None
        }
    })
}
