//! Primitives whose vertices and indices Draco has compressed (KHR_draco_mesh_compression). They are
//! decompressed before anything reads them, and read like all others from then on: the primitive is
//! given accessors of its own for what was in the stream.

use super::container::Buffers;
use super::document::{clip, malformed};
use super::limits::ImportLimits;
use super::warnings::Warnings;
use crate::scene::SceneError;
use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, ErrorKind, Mesh, MeshDecoder, PointAttribute, PointIndex,
};
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::{Checked, USize64};
use gltf::json::{Index, Root};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

const NAME: &str = "KHR_draco_mesh_compression";

/// Bytes of a triangle's indices.
const TRIANGLE_BYTES: usize = 12;

/// What the extension says of a primitive.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Object {
    buffer_view: usize,
    /// By semantic: the attribute's id in the stream.
    attributes: BTreeMap<String, u32>,
}

/// By accessor that the import made: where in the file it comes from.
pub(super) type Places = BTreeMap<usize, String>;

/// Decompresses the primitives that need it.
pub(super) fn decompress(
    root: &mut Root,
    buffers: &mut Buffers<'_>,
    limits: &ImportLimits,
    warnings: &mut Warnings,
) -> Result<Places, SceneError> {
    let is_required = root.extensions_required.iter().any(|name| name == NAME);
    let mut meshes = std::mem::take(&mut root.meshes);
    let mut streams = Streams {
        accessors: &mut root.accessors,
        buffers,
        warnings,
        max_triangles: limits.max_triangles,
        made: BTreeMap::new(),
        places: Places::new(),
    };
    for (mesh, object) in meshes.iter_mut().enumerate() {
        for (place, primitive) in object.primitives.iter_mut().enumerate() {
            let extensions = primitive.extensions.as_ref();
            let Some(object) = extensions.and_then(|all| all.others.get(NAME)) else { continue };
            let at = format!("meshes[{mesh}].primitives[{place}].extensions.{NAME}");
            let object = Object::deserialize(object)
                .map_err(|error| malformed(&at, clip(&error.to_string())))?;
            if is_required || !streams.has_all(primitive) {
                streams.replace(primitive, &object, &at)?;
            }
        }
    }
    let places = streams.places;
    root.meshes = meshes;
    Ok(places)
}

/// What a stream can hold, one of each number at most.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Indices,
    /// By id, by what its components are read as, and by whether they are normalised.
    Attribute(u32, u8, bool),
}

/// The file's compressed streams, and what was made of them.
struct Streams<'r, 'b> {
    accessors: &'r mut Vec<Accessor>,
    buffers: &'r mut Buffers<'b>,
    warnings: &'r mut Warnings,
    max_triangles: usize,
    /// By buffer view: the accessors of what was in it. Primitives may share a stream.
    made: BTreeMap<(usize, Part), Index<Accessor>>,
    places: Places,
}

impl Streams<'_, '_> {
    /// Whether a primitive can be read without its stream.
    fn has_all(&self, primitive: &Primitive) -> bool {
        primitive.attributes.values().chain(&primitive.indices).all(|index| {
            let accessor = &self.accessors[index.value()];
            accessor.buffer_view.is_some() || accessor.sparse.is_some()
        })
    }

    /// Gives a primitive the vertices and indices of its stream.
    fn replace(
        &mut self,
        primitive: &mut Primitive,
        object: &Object,
        at: &str,
    ) -> Result<(), SceneError> {
        if !matches!(primitive.mode, Checked::Valid(Mode::Triangles | Mode::TriangleStrip)) {
            return Err(malformed(at, "compresses what are no triangles"));
        }
        let view = object.buffer_view;
        let mut wanted = Vec::new();
        for (semantic, index) in &primitive.attributes {
            let Checked::Valid(semantic) = semantic else { continue };
            let Some(id) = object.attributes.get(&semantic.to_string()) else { continue };
            let component = self.component(*index, at)? as u8;
            let normalized = self.accessors[index.value()].normalized;
            let part = Part::Attribute(*id, component, normalized);
            wanted.push((semantic.clone(), part, *index));
        }
        let is_made = |part| self.made.contains_key(&(view, part));
        if !is_made(Part::Indices) || !wanted.iter().all(|(_, part, _)| is_made(*part)) {
            let mesh = self.decode(primitive, view, at)?;
            self.add_indices(view, &mesh, at)?;
            for (semantic, part, index) in &wanted {
                self.add_attribute((view, *part), &mesh, (semantic, *index), at)?;
            }
        }
        primitive.indices = Some(self.made[&(view, Part::Indices)]);
        // What Draco holds are separate triangles.
        primitive.mode = Checked::Valid(Mode::Triangles);
        for (semantic, part, _) in wanted {
            primitive.attributes.insert(Checked::Valid(semantic), self.made[&(view, part)]);
        }
        Ok(())
    }

    /// What an accessor's components are.
    fn component(&self, index: Index<Accessor>, at: &str) -> Result<ComponentType, SceneError> {
        super::document::valid(&self.accessors[index.value()].component_type, at)
            .map(|component| component.0)
    }

    /// The triangles and vertices that a primitive's accessors promise.
    fn promised(&self, primitive: &Primitive) -> (u64, Option<u64>) {
        let count = |index: &Index<Accessor>| self.accessors[index.value()].count.0;
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions)).map(count);
        let corners = primitive.indices.as_ref().map(count).or(positions).unwrap_or(0);
        let triangles = match primitive.mode {
            Checked::Valid(Mode::TriangleStrip) => corners.saturating_sub(2),
            _ => corners / 3,
        };
        (triangles, positions)
    }

    /// Decodes a primitive's stream, to no more than its accessors promise and the limits allow.
    fn decode(&mut self, primitive: &Primitive, view: usize, at: &str) -> Result<Mesh, SceneError> {
        if !self.buffers.has_view(view) {
            let what = format!("{view} is not the index of a buffer view");
            return Err(malformed(format!("{at}.bufferView"), what));
        }
        let (triangles, vertices) = self.promised(primitive);
        let limits = DecodeLimits::permissive()
            .with_max_faces(triangles.min(self.max_triangles as u64))
            .with_max_points(vertices.unwrap_or(0))
            .with_max_decoded_bytes(self.buffers.left());
        let stream = self.buffers.view(Index::new(view as u32)).0;
        let mut mesh = Mesh::new();
        // The decoder reads what may be anything: a panic there costs the upload, not the process.
        let decoded = catch_unwind(AssertUnwindSafe(|| {
            let mut stream = DecoderBuffer::new(stream).with_limits(limits);
            MeshDecoder::new().decode(&mut stream, &mut mesh)
        }));
        let decoded =
            decoded.map_err(|_| malformed(at, "cannot be decoded: the decoder gave up"))?;
        decoded.map_err(|error| match error.kind() {
            ErrorKind::LimitExceeded => SceneError::too_large(
                at,
                format!(
                    "has more than the accessors of the primitive say, or than is allowed: {}",
                    clip(error.message())
                ),
                "simplify the mesh, or export it again",
            ),
            _ => malformed(at, format!("cannot be decoded: {}", clip(error.message()))),
        })?;
        self.compare(&mesh, (triangles, vertices), at)?;
        Ok(mesh)
    }

    /// Refuses a mesh that nothing can be made of; warns where it is not what was promised.
    fn compare(
        &mut self,
        mesh: &Mesh,
        (triangles, vertices): (u64, Option<u64>),
        at: &str,
    ) -> Result<(), SceneError> {
        let (faces, points) = (mesh.num_faces() as u64, mesh.num_points() as u64);
        if faces == 0 {
            return Err(malformed(at, "holds no triangles"));
        }
        // Vertices that no triangle uses are possible, but nobody stores many of them.
        if points > 3 * triangles.max(vertices.unwrap_or(0)) {
            return Err(malformed(at, format!("holds {points} vertices for {faces} triangles")));
        }
        let past = mesh.faces().iter().flatten().find(|point| u64::from(point.0) >= points);
        if let Some(PointIndex(point)) = past {
            return Err(malformed(at, format!("refers to vertex {point} of {points}")));
        }
        let differs = |what: &str, found: u64, promised: u64| {
            format!(
                "holds {found} {what}, but its accessors say {promised}; the {what} that it holds are shown"
            )
        };
        if faces != triangles {
            self.warnings.push(at, differs("triangles", faces, triangles));
        }
        if let Some(vertices) = vertices.filter(|vertices| *vertices != points) {
            self.warnings.push(at, differs("vertices", points, vertices));
        }
        Ok(())
    }

    fn add_indices(&mut self, view: usize, mesh: &Mesh, at: &str) -> Result<(), SceneError> {
        self.buffers.spend(at, (mesh.num_faces() * TRIANGLE_BYTES) as u64)?;
        let corners = mesh.faces().iter().flatten();
        let bytes = corners.flat_map(|point| point.0.to_le_bytes()).collect();
        let accessor = Made {
            component: ComponentType::U32,
            kind: Type::Scalar,
            count: 3 * mesh.num_faces(),
            normalized: false,
        };
        self.add((view, Part::Indices), accessor, bytes, format!("{at}.indices"));
        Ok(())
    }

    /// Adds an attribute of the stream, whose components are to be read as those of the accessor
    /// that the primitive has for it.
    fn add_attribute(
        &mut self,
        (view, part): (usize, Part),
        mesh: &Mesh,
        (semantic, index): (&Semantic, Index<Accessor>),
        at: &str,
    ) -> Result<(), SceneError> {
        let Part::Attribute(id, _, normalized) = part else { return Ok(()) };
        let at = format!("{at}.attributes.{}", semantic.to_string());
        let attribute = mesh.attribute_by_unique_id(id).ok_or_else(|| {
            malformed(&at, format!("the stream has no attribute whose id is {id}"))
        })?;
        let (kind, components) = match attribute.num_components() {
            1 => (Type::Scalar, 1),
            2 => (Type::Vec2, 2),
            3 => (Type::Vec3, 3),
            4 => (Type::Vec4, 4),
            other => return Err(malformed(at, format!("has {other} components"))),
        };
        let component = self.component(index, &at)?;
        let count = mesh.num_points();
        self.buffers.spend(&at, (count * components * component.size()) as u64)?;
        let bytes = read(attribute, count, component)
            .ok_or_else(|| malformed(&at, "lacks values in the stream"))?;
        self.add((view, part), Made { component, kind, count, normalized }, bytes, at);
        Ok(())
    }

    fn add(&mut self, key: (usize, Part), made: Made, bytes: Vec<u8>, at: String) {
        let Made { component, kind, count, normalized } = made;
        self.places.insert(self.accessors.len(), at);
        self.made.insert(key, Index::new(self.accessors.len() as u32));
        self.accessors.push(Accessor {
            buffer_view: Some(self.buffers.add(bytes)),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Checked::Valid(GenericComponentType(component)),
            extensions: None,
            extras: Default::default(),
            type_: Checked::Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized,
            sparse: None,
        });
    }
}

/// What an accessor says of its elements.
struct Made {
    component: ComponentType,
    kind: Type,
    count: usize,
    normalized: bool,
}

/// The values of `count` points, tightly packed; `None` where one is missing.
fn read(attribute: &PointAttribute, count: usize, component: ComponentType) -> Option<Vec<u8>> {
    let (data, components) = (attribute.buffer().data(), usize::from(attribute.num_components()));
    let stored = Stored::of(attribute.data_type())?;
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let length = components * stored.size();
    let mut bytes = Vec::with_capacity(count * components * component.size());
    for point in 0..count {
        let value = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
        let begin = value.checked_mul(stride)?;
        let value = data.get(begin..begin.checked_add(length)?)?;
        for number in value.chunks_exact(stored.size()) {
            stored.convert(number, component, &mut bytes);
        }
    }
    Some(bytes)
}

/// How a stream's numbers are stored once decoded.
#[derive(Clone, Copy)]
struct Stored(DataType);

impl Stored {
    fn of(stored: DataType) -> Option<Self> {
        let known = !matches!(stored, DataType::Invalid | DataType::Bool);
        known.then_some(Self(stored))
    }

    fn size(self) -> usize {
        self.0.byte_length()
    }

    fn value(self, bytes: &[u8]) -> f64 {
        match (self.0, bytes) {
            (DataType::Int8, &[a]) => f64::from(a as i8),
            (DataType::Uint8, &[a]) => f64::from(a),
            (DataType::Int16, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
            (DataType::Uint16, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
            (DataType::Int32, &[a, b, c, d]) => f64::from(i32::from_le_bytes([a, b, c, d])),
            (DataType::Uint32, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
            (DataType::Float32, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
            (_, bytes) => match (self.0, <[u8; 8]>::try_from(bytes)) {
                (DataType::Int64, Ok(bytes)) => i64::from_le_bytes(bytes) as f64,
                (DataType::Uint64, Ok(bytes)) => u64::from_le_bytes(bytes) as f64,
                (DataType::Float64, Ok(bytes)) => f64::from_le_bytes(bytes),
                _ => 0.0,
            },
        }
    }

    /// Appends a number as an accessor has it; out of range is the nearest that there is.
    fn convert(self, bytes: &[u8], component: ComponentType, out: &mut Vec<u8>) {
        let value = self.value(bytes);
        match component {
            ComponentType::I8 => out.extend((value as i8).to_le_bytes()),
            ComponentType::U8 => out.push(value as u8),
            ComponentType::I16 => out.extend((value as i16).to_le_bytes()),
            ComponentType::U16 => out.extend((value as u16).to_le_bytes()),
            ComponentType::U32 => out.extend((value as u32).to_le_bytes()),
            ComponentType::F32 => out.extend((value as f32).to_le_bytes()),
        }
    }
}
