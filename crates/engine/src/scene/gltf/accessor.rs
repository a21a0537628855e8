//! Accessors: typed reads from buffer views, every bound checked before the first read.

use super::container::Buffers;
use super::json::{Object, malformed};
use crate::scene::SceneError;

/// Most entries of all sparse accessors together; they are looked at once when the file is opened.
const MAX_SPARSE_ENTRIES: u64 = 16 << 20;

/// Type of one component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn read(self, bytes: &[u8], normalized: bool) -> f32 {
        let (value, largest) = match (self, bytes) {
            (Self::I8, &[a, ..]) => (f32::from(a as i8), 127.0),
            (Self::U8, &[a, ..]) => (f32::from(a), 255.0),
            (Self::I16, &[a, b, ..]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
            (Self::U16, &[a, b, ..]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
            (Self::U32, &[a, b, c, d, ..]) => {
                (u32::from_le_bytes([a, b, c, d]) as f32, u32::MAX as f32)
            }
            (Self::F32, &[a, b, c, d, ..]) => return f32::from_le_bytes([a, b, c, d]),
            _ => return 0.0,
        };
        if normalized { (value / largest).max(-1.0) } else { value }
    }

    fn read_index(self, bytes: &[u8]) -> u32 {
        match (self, bytes) {
            (Self::U8, &[a, ..]) => u32::from(a),
            (Self::U16, &[a, b, ..]) => u32::from(u16::from_le_bytes([a, b])),
            (Self::U32, &[a, b, c, d, ..]) => u32::from_le_bytes([a, b, c, d]),
            _ => 0,
        }
    }

    /// Whether the component can index vertices.
    pub fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    /// The value that means primitive restart.
    pub fn restart(self) -> u32 {
        match self {
            Self::U8 => 0xff,
            Self::U16 => 0xffff,
            _ => u32::MAX,
        }
    }
}

/// Values that replace some elements.
struct Sparse<'a> {
    component: Component,
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
    /// `SCALAR`, `VEC2`, ….
    pub kind: &'static str,
    /// Components of an element.
    pub width: usize,
    /// Type of a component.
    pub component: Component,
    /// Number of elements.
    pub count: usize,
    normalized: bool,
    element_bytes: usize,
    stride: usize,
    /// From the first element on; `None` reads as zeros.
    bytes: Option<&'a [u8]>,
    sparse: Option<Sparse<'a>>,
}

/// Reads and checks every accessor of the file, used or not.
pub(super) fn accessors<'a>(
    root: &Object<'_>,
    buffers: &'a Buffers<'_>,
) -> Result<Vec<Accessor<'a>>, SceneError> {
    let mut sparse_entries = 0;
    root.objects("accessors")?
        .iter()
        .map(|object| {
            let accessor = accessor(object, buffers, &mut sparse_entries)?;
            Ok(accessor)
        })
        .collect()
}

fn component(object: &Object<'_>) -> Result<Component, SceneError> {
    let code = object.integer("componentType")?.ok_or_else(|| object.missing("componentType"))?;
    Component::from_code(code).ok_or_else(|| {
        malformed(object.path("componentType"), format!("{code} is not a component type"))
    })
}

fn accessor<'a>(
    object: &Object<'_>,
    buffers: &'a Buffers<'_>,
    sparse_entries: &mut u64,
) -> Result<Accessor<'a>, SceneError> {
    let component = component(object)?;
    let name = object.string("type")?.ok_or_else(|| object.missing("type"))?;
    let (kind, columns, rows) = match name {
        "SCALAR" => ("SCALAR", 1, 1),
        "VEC2" => ("VEC2", 1, 2),
        "VEC3" => ("VEC3", 1, 3),
        "VEC4" => ("VEC4", 1, 4),
        "MAT2" => ("MAT2", 2, 2),
        "MAT3" => ("MAT3", 3, 3),
        "MAT4" => ("MAT4", 4, 4),
        _ => return Err(malformed(object.path("type"), "is not an accessor type")),
    };
    // Matrix columns begin on four-byte boundaries.
    let column_bytes = rows * component.bytes();
    let element_bytes =
        if columns == 1 { column_bytes } else { columns * column_bytes.next_multiple_of(4) };
    let count = object.integer("count")?.ok_or_else(|| object.missing("count"))?;
    if count == 0 || count > u64::from(u32::MAX) {
        return Err(malformed(object.path("count"), format!("{count} is not in 1…2³²−1")));
    }
    let count = count as usize;
    let (mut bytes, mut stride) = (None, element_bytes);
    if let Some(view) = object.index("bufferView", buffers.view_count(), "buffer views")? {
        let range;
        (range, stride) = elements(object, buffers, view, count, element_bytes, true)?;
        bytes = Some(range);
    }
    let sparse = match object.object("sparse")? {
        Some(sparse) => Some(read_sparse(&sparse, buffers, count, element_bytes, sparse_entries)?),
        None => None,
    };
    Ok(Accessor {
        at: object.at.clone(),
        kind,
        width: columns * rows,
        component,
        count,
        normalized: object.flag("normalized")?,
        element_bytes,
        stride,
        bytes,
        sparse,
    })
}

/// The bytes of `count` elements from `object`'s offset on within a view, and their stride.
fn elements<'a>(
    object: &Object<'_>,
    buffers: &'a Buffers<'_>,
    view: usize,
    count: usize,
    element_bytes: usize,
    strided: bool,
) -> Result<(&'a [u8], usize), SceneError> {
    let offset = object.integer("byteOffset")?.unwrap_or(0);
    let (bytes, stride) = buffers
        .view(view)
        .ok_or_else(|| malformed(object.path("bufferView"), "names no buffer view"))?;
    let stride = stride.filter(|_| strided).unwrap_or(element_bytes);
    if stride < element_bytes {
        return Err(malformed(
            format!("bufferViews[{view}].byteStride"),
            format!(
                "{stride} is less than the {element_bytes} bytes of an element of {}",
                object.at
            ),
        ));
    }
    let needed = (count as u64 - 1)
        .checked_mul(stride as u64)
        .and_then(|bytes| bytes.checked_add(element_bytes as u64))
        .and_then(|bytes| bytes.checked_add(offset));
    match needed {
        Some(needed) if needed <= bytes.len() as u64 => Ok((&bytes[offset as usize..], stride)),
        _ => Err(malformed(
            &object.at,
            format!(
                "{count} elements of {element_bytes} bytes, every {stride} bytes from offset {offset}, \
                 do not fit buffer view {view} of {} bytes",
                bytes.len()
            ),
        )),
    }
}

fn read_sparse<'a>(
    object: &Object<'_>,
    buffers: &'a Buffers<'_>,
    elements_count: usize,
    element_bytes: usize,
    entries: &mut u64,
) -> Result<Sparse<'a>, SceneError> {
    let count = object.integer("count")?.ok_or_else(|| object.missing("count"))?;
    if count == 0 || count > elements_count as u64 {
        return Err(malformed(
            object.path("count"),
            format!("{count} is not in 1…{elements_count}, the accessor's own count"),
        ));
    }
    *entries += count;
    if *entries > MAX_SPARSE_ENTRIES {
        return Err(SceneError::too_large(
            object.path("count"),
            format!("more than {MAX_SPARSE_ENTRIES} sparse entries in the file"),
            "store the accessors densely",
        ));
    }
    let count = count as usize;
    let part = |key: &str| object.object(key)?.ok_or_else(|| object.missing(key));
    let view_of = |part: &Object<'_>| {
        part.index("bufferView", buffers.view_count(), "buffer views")?
            .ok_or_else(|| part.missing("bufferView"))
    };
    let (index_part, value_part) = (part("indices")?, part("values")?);
    let component = component(&index_part)?;
    if !component.is_index() {
        return Err(malformed(index_part.path("componentType"), "is not an unsigned integer type"));
    }
    let (indices, _) =
        elements(&index_part, buffers, view_of(&index_part)?, count, component.bytes(), false)?;
    let (values, _) =
        elements(&value_part, buffers, view_of(&value_part)?, count, element_bytes, false)?;
    let sparse = Sparse { component, indices, values, count };
    let mut previous = None;
    for entry in 0..count {
        let index = sparse.index(entry);
        if previous.is_some_and(|previous| index <= previous) || index as usize >= elements_count {
            return Err(malformed(
                &index_part.at,
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
        let begin = entry * self.component.bytes();
        self.indices.get(begin..).map_or(0, |bytes| self.component.read_index(bytes))
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
    /// Whether reading gives anything but zeros.
    pub fn has_data(&self) -> bool {
        self.bytes.is_some() || self.sparse.is_some()
    }

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
        for (component, value) in values.iter_mut().enumerate().take(self.width.min(4)) {
            let begin = component * self.component.bytes();
            *value = bytes.get(begin..).map_or(0.0, |b| self.component.read(b, self.normalized));
        }
        values
    }

    /// A scalar element as a vertex index.
    pub fn index(&self, element: usize) -> u32 {
        self.component.read_index(self.element_bytes_of(element))
    }
}
