//! Accessors: typed reads from buffer views, every bound checked before the first read.

use super::container::Buffers;
use super::document::{malformed, valid};
use super::draco::Places;
use crate::scene::SceneError;
use gltf::json::accessor::{self as json, ComponentType, Type};
use gltf::json::buffer::View;
use gltf::json::{Index, Root};

/// Most entries of all sparse accessors together; they are looked at once when the file is opened.
const MAX_SPARSE_ENTRIES: u64 = 16 << 20;

fn read(component: ComponentType, bytes: &[u8], normalized: bool) -> f32 {
    let (value, largest) = match (component, bytes) {
        (ComponentType::I8, &[a, ..]) => (f32::from(a as i8), 127.0),
        (ComponentType::U8, &[a, ..]) => (f32::from(a), 255.0),
        (ComponentType::I16, &[a, b, ..]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (ComponentType::U16, &[a, b, ..]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (ComponentType::U32, &[a, b, c, d, ..]) => {
            (u32::from_le_bytes([a, b, c, d]) as f32, u32::MAX as f32)
        }
        (ComponentType::F32, &[a, b, c, d, ..]) => return f32::from_le_bytes([a, b, c, d]),
        _ => return 0.0,
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

fn read_index(component: ComponentType, bytes: &[u8]) -> u32 {
    match (component, bytes) {
        (ComponentType::U8, &[a, ..]) => u32::from(a),
        (ComponentType::U16, &[a, b, ..]) => u32::from(u16::from_le_bytes([a, b])),
        (ComponentType::U32, &[a, b, c, d, ..]) => u32::from_le_bytes([a, b, c, d]),
        _ => 0,
    }
}

/// Values that replace some elements.
struct Sparse<'a> {
    component: ComponentType,
    /// Strictly increasing element numbers.
    indices: &'a [u8],
    /// One element for each number, tightly packed.
    values: &'a [u8],
    count: usize,
}

/// A checked accessor: all elements below `count` can be read.
pub(super) struct Accessor<'a> {
    /// Its place in the file.
    pub at: String,
    /// `Scalar`, `Vec2`, ….
    pub kind: Type,
    /// Type of a component.
    pub component: ComponentType,
    /// Number of elements.
    pub count: usize,
    normalized: bool,
    element_bytes: usize,
    stride: usize,
    /// From the first element on; `None` reads as zeros.
    bytes: Option<&'a [u8]>,
    sparse: Option<Sparse<'a>>,
}

/// Reads and checks every accessor of the file, used or not. `made` are those that are not in the
/// file itself.
pub(super) fn accessors<'a>(
    root: &Root,
    buffers: &'a Buffers<'_>,
    made: &Places,
) -> Result<Vec<Accessor<'a>>, SceneError> {
    let mut sparse_entries = 0;
    root.accessors
        .iter()
        .enumerate()
        .map(|(index, object)| {
            let at = made.get(&index).cloned().unwrap_or_else(|| format!("accessors[{index}]"));
            accessor(object, at, buffers, &mut sparse_entries)
        })
        .collect()
}

fn accessor<'a>(
    object: &json::Accessor,
    at: String,
    buffers: &'a Buffers<'_>,
    sparse_entries: &mut u64,
) -> Result<Accessor<'a>, SceneError> {
    let component = valid(&object.component_type, &at)?.0;
    let kind = valid(&object.type_, &at)?;
    // Matrix columns begin on four-byte boundaries.
    let matrix = |rows: usize| rows * (rows * component.size()).next_multiple_of(4);
    let element_bytes = match kind {
        Type::Mat2 => matrix(2),
        Type::Mat3 => matrix(3),
        Type::Mat4 => matrix(4),
        _ => kind.multiplicity() * component.size(),
    };
    let count = object.count.0;
    if count == 0 || count > u64::from(u32::MAX) {
        return Err(malformed(format!("{at}.count"), format!("{count} is not in 1…2³²−1")));
    }
    let count = count as usize;
    let elements = Elements { count, bytes: element_bytes };
    let (mut bytes, mut stride) = (None, element_bytes);
    if let Some(view) = object.buffer_view {
        stride = buffers.view(view).1.unwrap_or(element_bytes);
        let offset = object.byte_offset.unwrap_or_default().0;
        bytes = Some(Span { view, offset, elements, stride }.bytes(&at, buffers)?);
    }
    let sparse = match &object.sparse {
        Some(sparse) => Some(read_sparse(sparse, &at, buffers, elements, sparse_entries)?),
        None => None,
    };
    let normalized = object.normalized;
    Ok(Accessor { at, kind, component, count, normalized, element_bytes, stride, bytes, sparse })
}

/// How many elements an accessor has, and how long one is.
#[derive(Clone, Copy)]
struct Elements {
    count: usize,
    bytes: usize,
}

/// Where elements lie in a buffer view.
struct Span {
    view: Index<View>,
    /// Of the first one in the view, bytes.
    offset: u64,
    elements: Elements,
    /// From one to the next, bytes.
    stride: usize,
}

impl Span {
    /// What lies there, from the first element on; `at` names whose elements they are.
    fn bytes<'a>(&self, at: &str, buffers: &'a Buffers<'_>) -> Result<&'a [u8], SceneError> {
        let Self { view, offset, elements: Elements { count, bytes: element_bytes }, stride } =
            *self;
        let (bytes, _) = buffers.view(view);
        if stride < element_bytes {
            return Err(malformed(
                format!("bufferViews[{view}].byteStride"),
                format!("{stride} is less than the {element_bytes} bytes of an element of {at}"),
            ));
        }
        let needed = (count as u64 - 1)
            .checked_mul(stride as u64)
            .and_then(|bytes| bytes.checked_add(element_bytes as u64))
            .and_then(|bytes| bytes.checked_add(offset));
        match needed {
            Some(needed) if needed <= bytes.len() as u64 => Ok(&bytes[offset as usize..]),
            _ => Err(malformed(
                at,
                format!(
                    "{count} elements of {element_bytes} bytes, every {stride} bytes from offset {offset}, \
                     do not fit buffer view {view} of {} bytes",
                    bytes.len()
                ),
            )),
        }
    }
}

/// Checks the values that replace some of an accessor's elements; `entries` counts those of all
/// accessors.
fn read_sparse<'a>(
    object: &json::sparse::Sparse,
    at: &str,
    buffers: &'a Buffers<'_>,
    replaced: Elements,
    entries: &mut u64,
) -> Result<Sparse<'a>, SceneError> {
    let elements_count = replaced.count;
    let count = object.count.0;
    let count_at = || format!("{at}.sparse.count");
    if count == 0 || count > elements_count as u64 {
        return Err(malformed(
            count_at(),
            format!("{count} is not in 1…{elements_count}, the accessor's own count"),
        ));
    }
    *entries += count;
    if *entries > MAX_SPARSE_ENTRIES {
        return Err(SceneError::too_large(
            count_at(),
            format!("more than {MAX_SPARSE_ENTRIES} sparse entries in the file"),
            "store the accessors densely",
        ));
    }
    let count = count as usize;
    let (places, replacements) = (&object.indices, &object.values);
    let indices_at = format!("{at}.sparse.indices");
    let component = valid(&places.component_type, &indices_at)?.0;
    let packed = |at: &str, view, offset, bytes| {
        Span { view, offset, elements: Elements { count, bytes }, stride: bytes }.bytes(at, buffers)
    };
    let (view, offset) = (places.buffer_view, places.byte_offset.0);
    let indices = packed(&indices_at, view, offset, component.size())?;
    let (view, offset) = (replacements.buffer_view, replacements.byte_offset.0);
    let values = packed(&format!("{at}.sparse.values"), view, offset, replaced.bytes)?;
    let sparse = Sparse { component, indices, values, count };
    let mut previous = None;
    for entry in 0..count {
        let index = sparse.index(entry);
        if previous.is_some_and(|previous| index <= previous) || index as usize >= elements_count {
            return Err(malformed(
                indices_at,
                format!(
                    "entry {entry} is {index}: entries must increase and stay below {elements_count}"
                ),
            ));
        }
        previous = Some(index);
    }
    Ok(sparse)
}

impl Sparse<'_> {
    fn index(&self, entry: usize) -> u32 {
        let begin = entry * self.component.size();
        self.indices.get(begin..).map_or(0, |bytes| read_index(self.component, bytes))
    }

    /// The bytes that replace an element.
    fn replacement(&self, element: usize, element_bytes: usize) -> Option<&[u8]> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low + (high - low) / 2;
            match (self.index(middle) as usize).cmp(&element) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Greater => high = middle,
                std::cmp::Ordering::Equal => return self.values.get(middle * element_bytes..),
            }
        }
        None
    }
}

impl Accessor<'_> {
    fn element_bytes_of(&self, element: usize) -> &[u8] {
        self.sparse
            .as_ref()
            .and_then(|sparse| sparse.replacement(element, self.element_bytes))
            .or_else(|| self.bytes?.get(element * self.stride..))
            .unwrap_or(&[])
    }

    /// The first up to four components of an element; missing ones are 0.
    pub fn element(&self, element: usize) -> [f32; 4] {
        let bytes = self.element_bytes_of(element);
        let mut values = [0.0; 4];
        for (component, value) in values.iter_mut().enumerate().take(self.kind.multiplicity()) {
            let begin = component * self.component.size();
            *value = bytes.get(begin..).map_or(0.0, |b| read(self.component, b, self.normalized));
        }
        values
    }

    /// An element of a matrix of four columns of floats.
    pub fn matrix(&self, element: usize) -> [f32; 16] {
        let bytes = self.element_bytes_of(element);
        std::array::from_fn(|place| {
            bytes.get(4 * place..).map_or(0.0, |bytes| read(ComponentType::F32, bytes, false))
        })
    }

    /// A scalar element as a vertex index.
    pub fn index(&self, element: usize) -> u32 {
        read_index(self.component, self.element_bytes_of(element))
    }

    /// Whether the elements can be vertex indices.
    pub fn is_index(&self) -> bool {
        use ComponentType::{U8, U16, U32};
        self.kind == Type::Scalar && matches!(self.component, U8 | U16 | U32)
    }

    /// The vertex index that means primitive restart.
    pub fn restart(&self) -> u32 {
        match self.component {
            ComponentType::U8 => 0xff,
            ComponentType::U16 => 0xffff,
            _ => u32::MAX,
        }
    }
}
