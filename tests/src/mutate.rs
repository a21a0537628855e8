//! Bytes near valid ones: seeds, mutated the way a fuzzer does, but without looking at coverage, so
//! that it runs anywhere. The same number gives the same bytes.

/// Longest mutant.
const MAX_BYTES: usize = 64 << 10;
/// What parsers trip over.
const WORDS: &[&[u8]] = &[
    b"\0",
    b"\r\n",
    b"\r\n\r\n",
    b"--x",
    b"--x--",
    b"\r\n--x\r\n",
    b"\"",
    b"\\",
    b"\\u0000",
    b"\\ud800",
    b"{",
    b"}",
    b"[",
    b"]",
    b":",
    b",",
    b"null",
    b"true",
    b"-1",
    b"0",
    b"1e999",
    b"-0.0",
    b"18446744073709551616",
    b"9007199254740993",
    b"NaN",
    b"\xff",
    b"\xc3\x28",
    b"\xed\xa0\x80",
    b"name=",
    b"filename=",
    b"content-disposition: form-data; name=\"scene\"",
    b"name=\"job\"",
    b"../",
    b"%00",
    b"%ff",
    b"file:///etc/passwd",
    b"data:;base64,",
    b"options",
    b"webhook",
    b"http://[::1]/",
    b"\xef\xbb\xbf",
    b"[[[[[[[[[[[[[[[[",
];

/// Random numbers and the mutations that they make.
pub struct Mutator(u64);

impl Mutator {
    /// One of many sequences.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    /// A stretch of `bytes`, up to some 64 long.
    fn stretch(&mut self, bytes: &[u8]) -> std::ops::Range<usize> {
        let start = self.below(bytes.len() + 1);
        let longest = 1 << self.below(7);
        start..(start + self.below(longest + 1)).min(bytes.len())
    }

    /// A mutant of one of the seeds, with parts of the others.
    pub fn mutant(&mut self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seeds[self.below(seeds.len())].clone();
        for _ in 0..=self.below(6) {
            let at = self.stretch(&bytes);
            match self.below(7) {
                0 => {
                    if let Some(byte) = bytes.get_mut(at.start) {
                        *byte ^= 1 << (self.0 % 8);
                    }
                }
                1 => drop(bytes.drain(at)),
                2 => {
                    let copy = bytes[at.clone()].to_vec();
                    for _ in 0..=self.below(8) {
                        bytes.splice(at.start..at.start, copy.iter().copied());
                    }
                }
                3 | 4 => {
                    let word = WORDS[self.below(WORDS.len())];
                    let end = if self.below(2) == 0 { at.start } else { at.end };
                    bytes.splice(at.start..end, word.iter().copied());
                }
                5 => {
                    let other = &seeds[self.below(seeds.len())];
                    let part = self.stretch(other);
                    bytes.splice(at, other[part].iter().copied());
                }
                _ => bytes.truncate(at.end),
            }
            bytes.truncate(MAX_BYTES);
        }
        bytes
    }
}
