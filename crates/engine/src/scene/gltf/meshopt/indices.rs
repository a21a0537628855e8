//! Modes 1 and 2: triangles, most of which take one byte since they share an edge with one just
//! before them, and other indices as differences.

/// Why a stream is refused.
type Why = &'static str;
const SHORT: Why = "it ends too early";
const LONG: Why = "it has more bytes than its indices need";

/// Entries that a queue remembers.
const REMEMBERED: usize = 16;
/// Bytes of the table at the end of triangles.
const TABLE: usize = 16;
/// Bytes at the end of indices.
const PADDING: usize = 4;

/// The last entries that were pushed.
struct Queue<T> {
    entries: [T; REMEMBERED],
    pushed: usize,
}

impl<T: Copy + Default> Queue<T> {
    fn new() -> Self {
        Self { entries: [T::default(); REMEMBERED], pushed: 0 }
    }

    fn push(&mut self, entry: T) {
        self.entries[self.pushed % REMEMBERED] = entry;
        self.pushed += 1;
    }

    /// The entry pushed `back` pushes before the last.
    fn get(&self, back: usize) -> Result<T, Why> {
        let place = self.pushed.checked_sub(back + 1).filter(|_| back < REMEMBERED);
        place.map(|place| self.entries[place % REMEMBERED]).ok_or("it refers to what is not there")
    }
}

/// The bytes behind the codes, and the indices that differences count from.
struct Data<'a> {
    bytes: &'a [u8],
    /// The highest index yet, plus one.
    next: u32,
    last: u32,
}

impl Data<'_> {
    fn byte(&mut self) -> Result<u8, Why> {
        let (byte, rest) = self.bytes.split_first().ok_or(SHORT)?;
        self.bytes = rest;
        Ok(*byte)
    }

    /// A number in one to five bytes of seven bits, the lowest first.
    fn number(&mut self) -> Result<u32, Why> {
        let mut number = 0;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            number |= u32::from(byte & 127) << shift;
            if byte < 128 {
                return Ok(number);
            }
        }
        Err("a number has more than five bytes")
    }

    /// An index as its difference from the last one stored so.
    fn index(&mut self) -> Result<u32, Why> {
        self.last = self.last.wrapping_add(signed(self.number()?));
        Ok(self.last)
    }

    /// The index that no triangle has had yet.
    fn fresh(&mut self) -> u32 {
        let fresh = self.next;
        self.next = self.next.wrapping_add(1);
        fresh
    }
}

/// A difference whose lowest bit is its sign.
fn signed(stored: u32) -> u32 {
    (stored >> 1) ^ (stored & 1).wrapping_neg()
}

struct Triangles<'a> {
    data: Data<'a>,
    edges: Queue<(u32, u32)>,
    vertices: Queue<u32>,
    table: &'a [u8],
}

impl Triangles<'_> {
    fn next(&mut self, code: u8) -> Result<[u32; 3], Why> {
        match (code >> 4, code & 15) {
            (15, 14..) => self.explicit(code & 1 == 1),
            (15, place) => {
                let corners = self.table[usize::from(place)];
                let a = self.data.fresh();
                self.corners(a, corners)
            }
            (edge, corner) => self.on_edge(usize::from(edge), corner),
        }
    }

    /// A triangle on an edge of one before it.
    fn on_edge(&mut self, edge: usize, corner: u8) -> Result<[u32; 3], Why> {
        let (a, b) = self.edges.get(edge)?;
        let c = match corner {
            0 => self.data.fresh(),
            13 | 14 => {
                let step = if corner == 13 { u32::MAX } else { 1 };
                self.data.last = self.data.last.wrapping_add(step);
                self.data.last
            }
            15 => self.data.index()?,
            back => self.vertices.get(usize::from(back))?,
        };
        self.edges.push((c, b));
        self.edges.push((a, c));
        if !(1..13).contains(&corner) {
            self.vertices.push(c);
        }
        Ok([a, b, c])
    }

    /// A triangle whose first corner is stored where `stores_a`, and is a fresh one otherwise.
    fn explicit(&mut self, stores_a: bool) -> Result<[u32; 3], Why> {
        let corners = self.data.byte()?;
        if corners == 0 {
            self.data.next = 0;
        }
        let a = if stores_a { self.data.index()? } else { self.data.fresh() };
        self.corners(a, corners)
    }

    /// A triangle of `a` and two corners of four bits each: 0 for a fresh one, 15 for one that is
    /// stored, anything else for one of the last vertices.
    fn corners(&mut self, a: u32, corners: u8) -> Result<[u32; 3], Why> {
        let codes = [corners >> 4, corners & 15];
        let mut rest = [0; 2];
        for (corner, code) in rest.iter_mut().zip(codes) {
            *corner = match code {
                0 => self.data.fresh(),
                15 => self.data.index()?,
                back => self.vertices.get(usize::from(back) - 1)?,
            };
        }
        let [b, c] = rest;
        for edge in [(b, a), (c, b), (a, c)] {
            self.edges.push(edge);
        }
        self.vertices.push(a);
        for (corner, code) in rest.into_iter().zip(codes) {
            if matches!(code, 0 | 15) {
                self.vertices.push(corner);
            }
        }
        Ok([a, b, c])
    }
}

/// Decodes `count` corners of triangles into indices of `stride` bytes, 2 or 4.
pub(super) fn triangles(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Why> {
    let rest = stream.strip_prefix(&[0xe1]).ok_or("it does not begin like triangles")?;
    let (codes, rest) = rest.split_at_checked(count / 3).ok_or(SHORT)?;
    let (bytes, table) = rest.split_at_checked(rest.len().wrapping_sub(TABLE)).ok_or(SHORT)?;
    // The table's entries are read where 15 could not mean a stored index.
    if table[14..] != [0, 0] || table.iter().any(|pair| pair >> 4 == 15 || pair & 15 == 15) {
        return Err("its table is not one that triangles may have");
    }
    let data = Data { bytes, next: 0, last: 0 };
    let mut state = Triangles { data, edges: Queue::new(), vertices: Queue::new(), table };
    let mut decoded = Vec::with_capacity(count * stride);
    for code in codes {
        for index in state.next(*code)? {
            decoded.extend_from_slice(&index.to_le_bytes()[..stride]);
        }
    }
    if state.data.bytes.is_empty() { Ok(decoded) } else { Err(LONG) }
}

/// Decodes `count` indices of `stride` bytes, 2 or 4.
pub(super) fn indices(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Why> {
    let rest = stream.strip_prefix(&[0xd1]).ok_or("it does not begin like indices")?;
    let (bytes, _) = rest.split_at_checked(rest.len().wrapping_sub(PADDING)).ok_or(SHORT)?;
    // Each takes a byte at least.
    if count > bytes.len() {
        return Err(SHORT);
    }
    let mut data = Data { bytes, next: 0, last: 0 };
    let mut last = [0u32; 2];
    let mut decoded = Vec::with_capacity(count * stride);
    for _ in 0..count {
        let stored = data.number()?;
        let baseline = &mut last[(stored & 1) as usize];
        *baseline = baseline.wrapping_add(signed(stored >> 1));
        decoded.extend_from_slice(&baseline.to_le_bytes()[..stride]);
    }
    if data.bytes.is_empty() { Ok(decoded) } else { Err(LONG) }
}
