//! Mode 0, attributes: elements of a fixed number of bytes, each stored as its difference from the
//! one before it; the differences of every byte position lie together, packed into few bits.

/// Elements whose differences are packed together.
const GROUP: usize = 16;
/// Most elements of a block.
const MAX_BLOCK: usize = 256;
/// Bytes of a block's elements, at most.
const BLOCK_BYTES: usize = 8192;
/// Bytes that share a channel mode.
const CHANNEL: usize = 4;

/// Why a stream is refused.
type Why = &'static str;
const SHORT: Why = "it ends too early";

/// What is left of a stream to read.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Why> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(SHORT)?;
        self.0 = rest;
        Ok(taken)
    }
}

/// How the differences of one byte position of a block are stored.
#[derive(Clone, Copy)]
enum Control {
    /// Packed, by group, into one of these numbers of bits.
    Packed([u32; 4]),
    /// Not at all: all are 0.
    Zero,
    /// As they are.
    Literal,
}

/// How elements follow from differences, for four bytes of them.
#[derive(Clone, Copy)]
enum Delta {
    /// Byte by byte, added.
    Bytes,
    /// As two numbers of 16 bits, added.
    Shorts,
    /// As one number of 32 bits: exclusive or, after a rotation to the right by so many bits.
    Xor(u32),
}

impl Delta {
    fn of(mode: u8) -> Result<Self, Why> {
        match (mode & 15, mode >> 4) {
            (0, 0) => Ok(Self::Bytes),
            (1, 0) => Ok(Self::Shorts),
            (2, rotation) => Ok(Self::Xor(u32::from(rotation))),
            _ => Err("a channel has an unknown mode"),
        }
    }

    /// The four bytes of an element, from those of the one before it and the stored difference.
    fn next(self, previous: [u8; CHANNEL], stored: [u8; CHANNEL]) -> [u8; CHANNEL] {
        match self {
            Self::Bytes => std::array::from_fn(|byte| {
                let delta = (stored[byte] >> 1) ^ (stored[byte] & 1).wrapping_neg();
                previous[byte].wrapping_add(delta)
            }),
            Self::Shorts => {
                let half = |low: usize| {
                    let before = u16::from_le_bytes([previous[low], previous[low + 1]]);
                    let stored = u16::from_le_bytes([stored[low], stored[low + 1]]);
                    let delta = (stored >> 1) ^ (stored & 1).wrapping_neg();
                    before.wrapping_add(delta).to_le_bytes()
                };
                let ([a, b], [c, d]) = (half(0), half(2));
                [a, b, c, d]
            }
            Self::Xor(rotation) => {
                let stored = u32::from_le_bytes(stored).rotate_right(rotation);
                (u32::from_le_bytes(previous) ^ stored).to_le_bytes()
            }
        }
    }
}

/// The parts of a stream around its blocks.
struct Stream<'a> {
    blocks: Bytes<'a>,
    /// What the first element is a difference from.
    baseline: &'a [u8],
    /// By channel.
    deltas: Vec<Delta>,
    /// Whether every block says how its bytes are stored.
    has_controls: bool,
}

impl<'a> Stream<'a> {
    fn open(stream: &'a [u8], stride: usize) -> Result<Self, Why> {
        let channels = stride / CHANNEL;
        let (header, rest) = stream.split_first().ok_or(SHORT)?;
        let (has_controls, modes, least_tail) = match header {
            0xa0 => (false, 0, 32),
            0xa1 => (true, channels, 24),
            _ => return Err("it does not begin like attributes"),
        };
        let tail = stride + modes;
        let blocks_end = rest.len().checked_sub(tail.max(least_tail)).ok_or(SHORT)?;
        let (baseline, modes) = rest[rest.len() - tail..].split_at(stride);
        let deltas = match has_controls {
            true => modes.iter().map(|mode| Delta::of(*mode)).collect::<Result<_, _>>()?,
            false => vec![Delta::Bytes; channels],
        };
        Ok(Self { blocks: Bytes(&rest[..blocks_end]), baseline, deltas, has_controls })
    }

    /// How the bytes of a block are stored, by byte position.
    fn controls(&mut self) -> Result<impl Fn(usize) -> Control + use<'a>, Why> {
        let count = if self.has_controls { self.deltas.len() } else { 0 };
        let packed = self.blocks.take(count)?;
        Ok(move |byte: usize| match packed.get(byte / CHANNEL) {
            None => Control::Packed([0, 2, 4, 8]),
            Some(modes) => match modes >> (2 * (byte % CHANNEL)) & 3 {
                0 => Control::Packed([0, 1, 2, 4]),
                1 => Control::Packed([1, 2, 4, 8]),
                2 => Control::Zero,
                _ => Control::Literal,
            },
        })
    }
}

/// Decodes `count` elements of `stride` bytes, a multiple of four up to 256.
pub(super) fn decode(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Why> {
    let mut stream = Stream::open(stream, stride)?;
    let most = (BLOCK_BYTES / stride / GROUP * GROUP).min(MAX_BLOCK);
    let mut decoded = vec![0; count * stride];
    let mut previous = stream.baseline.to_vec();
    for block in decoded.chunks_mut(most * stride) {
        let elements = block.len() / stride;
        let control = stream.controls()?;
        for channel in 0..stride / CHANNEL {
            let begin = channel * CHANNEL;
            let mut planes = [[0; MAX_BLOCK]; CHANNEL];
            for (byte, plane) in planes.iter_mut().enumerate() {
                let plane = &mut plane[..elements.next_multiple_of(GROUP)];
                read_plane(&mut stream.blocks, control(begin + byte), plane, elements)?;
            }
            let before = &mut previous[begin..begin + CHANNEL];
            let mut last: [u8; CHANNEL] = std::array::from_fn(|byte| before[byte]);
            for (place, element) in block.chunks_exact_mut(stride).enumerate() {
                last = stream.deltas[channel].next(last, planes.map(|plane| plane[place]));
                element[begin..begin + CHANNEL].copy_from_slice(&last);
            }
            before.copy_from_slice(&last);
        }
    }
    match stream.blocks.0 {
        [] => Ok(decoded),
        _ => Err("it has more bytes than its elements need"),
    }
}

/// Reads the stored differences of one byte position; `plane` has room for whole groups.
fn read_plane(
    bytes: &mut Bytes<'_>,
    control: Control,
    plane: &mut [u8],
    elements: usize,
) -> Result<(), Why> {
    let bits = match control {
        Control::Zero => return Ok(()),
        Control::Literal => {
            plane[..elements].copy_from_slice(bytes.take(elements)?);
            return Ok(());
        }
        Control::Packed(bits) => bits,
    };
    let groups = plane.len() / GROUP;
    let headers = bytes.take(groups.div_ceil(4))?;
    for (group, values) in plane.chunks_exact_mut(GROUP).enumerate() {
        let choice = headers[group / 4] >> (2 * (group % 4)) & 3;
        match bits[usize::from(choice)] {
            0 => {}
            8 => values.copy_from_slice(bytes.take(GROUP)?),
            bits => read_group(bytes, bits, values)?,
        }
    }
    Ok(())
}

/// Reads a group of 1, 2 or 4 bits a value; a value of all ones stands for a byte that follows.
fn read_group(bytes: &mut Bytes<'_>, bits: u32, values: &mut [u8]) -> Result<(), Why> {
    let packed = bytes.take(GROUP * bits as usize / 8)?;
    let (per_byte, sentinel) = (8 / bits as usize, (1u8 << bits) - 1);
    for (place, value) in values.iter_mut().enumerate() {
        let nth = (place % per_byte) as u32;
        // Single bits begin with the lowest, wider values with the highest.
        let shift = if bits == 1 { nth } else { 8 - bits * (nth + 1) };
        let code = packed[place / per_byte] >> shift & sentinel;
        *value = if code == sentinel { bytes.take(1)?[0] } else { code };
    }
    Ok(())
}
