//! Streams made by the reference encoder, and what its decoder makes of them.

use super::filters::Filter;
use super::{attributes, indices};

/// The bytes of hexadecimal digits.
fn bytes(hex: &str) -> Vec<u8> {
    let digit = |byte: u8| (byte as char).to_digit(16).expect("a digit") as u8;
    hex.as_bytes().chunks(2).map(|pair| digit(pair[0]) << 4 | digit(pair[1])).collect()
}

/// Streams of attributes in versions 0 and 1: element size, elements, and what is stored.
fn attribute_streams() -> [(usize, Vec<u8>, [&'static str; 2]); 5] {
    let smooth = (0..40u32).flat_map(|i| {
        let component = move |c: u32| (i * i * (c + 1) * 3 + 1000 * c + i % 7 * c) as u16;
        (0..4).flat_map(move |c| component(c).to_le_bytes())
    });
    let mut state = 1u32;
    let rough = (0..34).flat_map(|_| {
        state = state.wrapping_mul(1_103_515_245).wrapping_add(12345);
        ((state >> 16) as u16).to_le_bytes()
    });
    let floats = (0..35u16).flat_map(|i| {
        let component = move |c: u16| 1.0 + f32::from(i) * 0.25 + f32::from(c) * 8.0;
        (0..3).flat_map(move |c| component(c).to_le_bytes())
    });
    // Several blocks.
    let steps = (0..600u32).flat_map(|i| (i / 64).wrapping_mul(0x0102_0304).to_le_bytes());
    [
        (8, smooth.collect(), [SMOOTH_0, SMOOTH_1]),
        (4, rough.collect(), [ROUGH_0, ROUGH_1]),
        (12, floats.collect(), [FLOATS_0, FLOATS_1]),
        (4, steps.collect(), [STEPS_0, STEPS_1]),
        (16, vec![0; 4800], [ZEROS_0, ZEROS_1]),
    ]
}

const SMOOTH_0: &str = "a01f0006121e2a36424e5a66727e8a96a2aebac6d2deeaf6fdf1e5d9cdc1b5a99d91ffff000085796d6155493d\
     3115000008088222228a8aa200001f000e263e566e8690b6cee6fee9d1c7a189715941291f061e364e667e88ae\
     c6deffff0000f6f1d9cfa9917961250802088a2aaaabae040424424424000000001f00163a5e82a6cad2edc9a5\
     815d39310e32567a9ec2caf5d1ad89654139062a4effff00007296bac2fdd9b5912902088a2a22422424424444\
     4446446466000000001f001e4e7eaedef1eb916131012e5e64beeee1b181514b0e3e6e9ecefefba17141ffff00\
     00111e4e54aedef1c129020a2aab04242444444644664666686688000000000000000000000000000000000000\
     000000000000000000000000e803d007b80b";
const SMOOTH_1: &str = "a173770006121e2a36424e5a66727e8a96a2aebac6d2deeaf6020e1a26323e4a56626e7a86929eaab6c2ce2800\
     05555555550000000e263e566e8690b6cee6fe162e385e768ea6bed6e0061e364e667e88aec6def60e2630566e\
     869e2500000055555aaaaa233333330000000000163a5e82a6cad212365a7ea2c6ce0e32567a9ec2ca0a2e5276\
     9abec6062a4e7296bac202264a6e290000555622222233333334444444555500000000001e4e7eaede0e146e9e\
     cefe2e5e64beee1e4e7eaeb40e3e6e9ecefe045e8ebeee1e4e54aede0e3e29000555aa23333344444455555666\
     66770000000000000000000000000000000000000000e803d007b80b0101";
const ROUGH_0: &str = "a00700896bd1e4d281ca40604a8db04046dbc0000000a30700335b3f339632b4ca000ece472c16abc000000011\
     070025df00092d7ad6703ed7553e195e5dc00000000507005c5d0ee644fc2a1c229fd59a7c6216c0000000ce00\
     000000000000000000000000000000000000000000000000000000c6417e96";
const ROUGH_1: &str = "a1ff00896bd1e4d281ca40604a8db04046dba300335b3f339632b4ca000ece472c16ab110025df00092d7ad670\
     3ed7553e195e5d05005c5d0ee644fc2a1c229fd59a7c6216ce00000000000000000000000000000000000000c6\
     417e9600";
const FLOATS_0: &str = "a000001f0040404040202020202020202010101010101010101010101010101010080808fc0000000808080500\
     8000000000008000001a08888888888888888888888888888444fc0000000404040000001a0444444444444444\
     4444444444444444fc0000000404040000000000000000000000000000000000000000000000803f0000104100\
     008841";
const FLOATS_1: &str = "a1689a9a0110001f0a08f8f4c4f4c4f26218f81c3ce262f262e262f1311e7e07000701030a0888888888888888\
     888888888888844407000404040a04444444444444444444444444444444070004040400000000000000000000\
     00803f0000104100008841620000";
const ZEROS_0: &str = "a00000000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
     000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
     0000000000000000000000000000000000000000000000";
const ZEROS_1: &str = "a1aaaaaaaaaaaaaaaa000000000000000000000000000000000000000000000000";
const STEPS_0: &str = "a000010101c000000008c000000008c00000000800010101c000000006c000000006c00000000600010101c000\
     000004c000000004c0000000040001010180000000800000008000000001010101c000000008c000000008c000\
     000008c00000000801010101c000000006c000000006c000000006c00000000601010101c000000004c0000000\
     04c000000004c00000000401010101800000008000000080000000800000000101c000000008c0000000080101\
     c000000006c0000000060101c000000004c0000000040101800000008000000000000000000000000000000000\
     00000000000000000000000000000000000000";
const STEPS_1: &str = "a10000010101010008010008010008000101010100060100060100060001010101000401000401000400010101\
     010002010002010002000101010101000801000801000801000801010101010006010006010006010006010101\
     010100040100040100040100040101010101000201000201000201000200010101000801000801010100060100\
     0601010100040100040101010002010002000000000000000000000000000000000000000000000000";

/// Triangles of a grid, and six that are far from each other.
const TRIANGLES: &str = "e1fe1e100e100e100e100efe1e190e180e170e160eff1e160e160e160e160eff1e160e160e160e160eff1e160e\
     160e160e160effffffff0f0c9f025f090c5f090c5f090cff3f2211ff304522ffae0f0401ff8eb608d5c508d8c5\
     08007687566778a9866589689801690000";
/// Ten triangles that share no corner.
const SEPARATE: &str = "e1f0f0f0f0f0f0f0f0f0f0007687566778a9866589689801690000";
const SEQUENCE: &str = "d10091030405040504e9fc0f04040a068192e40100000000";

fn triangles() -> [(Vec<u32>, &'static str); 2] {
    let grid = (0..25).flat_map(|cell| {
        let a = cell / 5 * 6 + cell % 5;
        [a, a + 1, a + 6, a + 6, a + 1, a + 7]
    });
    let far = [3, 20, 11, 35, 0, 17, 1000, 1002, 1001, 70000, 5, 70001];
    [(grid.chain(far).collect(), TRIANGLES), ((0..30).collect(), SEPARATE)]
}

const INDICES: [u32; 13] = [0, 100, 1, 101, 2, 102, 3, 65536, 4, 5, 2, 0, 1_000_000];

#[test]
fn attributes_are_what_was_encoded() {
    for (stride, expected, streams) in attribute_streams() {
        for (version, stream) in streams.into_iter().enumerate() {
            let decoded = attributes::decode(&bytes(stream), expected.len() / stride, stride);
            assert!(decoded.as_ref() == Ok(&expected), "stride {stride}, version {version}");
        }
    }
}

#[test]
fn triangles_and_indices_are_what_was_encoded() {
    for (expected, stream) in triangles() {
        let stream = bytes(stream);
        let wide: Vec<u8> = expected.iter().flat_map(|index| index.to_le_bytes()).collect();
        assert_eq!(
            rotated(&indices::triangles(&stream, expected.len(), 4).unwrap()),
            rotated(&wide)
        );
        let narrow = indices::triangles(&stream, expected.len(), 2).unwrap();
        assert_eq!(narrow.len(), 2 * expected.len());
    }
    let wide: Vec<u8> = INDICES.iter().flat_map(|index| index.to_le_bytes()).collect();
    assert_eq!(indices::indices(&bytes(SEQUENCE), INDICES.len(), 4), Ok(wide));
    let narrow: Vec<u8> = INDICES.iter().flat_map(|index| (*index as u16).to_le_bytes()).collect();
    assert_eq!(indices::indices(&bytes(SEQUENCE), INDICES.len(), 2), Ok(narrow));
}

/// Triangles, each from its least corner on: the encoder may turn them.
fn rotated(bytes: &[u8]) -> Vec<[u32; 3]> {
    let (corners, _) = bytes.as_chunks::<4>();
    let corners: Vec<u32> = corners.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
    let turned = corners.as_chunks::<3>().0.iter().map(|&[a, b, c]| match a.min(b).min(c) {
        least if least == a => [a, b, c],
        least if least == b => [b, c, a],
        _ => [c, a, b],
    });
    turned.collect()
}

#[test]
fn filters_are_those_of_the_reference() {
    let cases = [
        (
            (Filter::Octahedral, 4, 1),
            "00007f007f7f7f7f36007f81b05c7f4055ab7f00",
            "00007f000000817f4c006681c451b34049b7b600",
        ),
        (
            (Filter::Octahedral, 4, 1),
            "00001f001f1f1f7f0d001f81ed161f4015eb1f00",
            "00007f000000817f4a006781c155ba4047b9b200",
        ),
        (
            (Filter::Octahedral, 8, 2),
            "00000000ff070000ff07ff07ff07ff7f6d030000ff070180fbfac405ff0700405505abfaff070000",
            "00000000ff7f0000000000000180ff7fc54c00006b66018097c2f35136b30040dd4923b607b60000",
        ),
        (
            (Filter::Quaternion, 8, 2),
            "000000000000ff1fa01660e9a016fc1f0000000001e0fc1f6df2930d8604fd1f",
            "000000000000ff7fff3f004000c00040825a000000007ea5cc0c33739ad96626",
        ),
        (
            (Filter::Exponential, 4, 0),
            "0000008e002000f300d0fff3f12900e2483c0003acc0ff15333300ef002800f4",
            "000000000000803f0000c0bf00c427370020f1470050fdd000cccc3d00002040",
        ),
        (
            (Filter::Exponential, 16, 0),
            "000000eb000020eb0000d0eb150000eb0f00000d89abc00d0000000d0000000d",
            "000000000000803f0000c0bf000028370000f047dc51fdd00000000000000000",
        ),
        (
            (Filter::Color, 4, 1),
            "000000ffff0000ff407fc1c066cd00807f007fa0",
            "000000fffffffffffe0100803366990000fe0040",
        ),
        (
            (Filter::Color, 4, 1),
            "0000003f3f00003f101ff1301af400201f001f28",
            "000000fffffffffffb04008239699a0000fb0041",
        ),
        (
            (Filter::Color, 8, 2),
            "000000000000ff0fff0f00000000ff0f0004ff0701fc000c6606cdfc00000008ff070000ff07000a",
            "000000000000ffffffffffffffffffffefff10000000088033336666999900000000efff00000440",
        ),
    ];
    for ((filter, stride, width), stored, expected) in cases {
        let mut filtered = bytes(stored);
        filter.apply(&mut filtered, stride);
        let expected = bytes(expected);
        // The extension allows one unit in the last place, and none of floats.
        let same = match width {
            0 => filtered == expected,
            1 => filtered.iter().zip(&expected).all(|(a, b)| (a.wrapping_sub(*b) as i8).abs() <= 1),
            _ => {
                let numbers = |bytes: &[u8]| -> Vec<u16> {
                    bytes.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect()
                };
                let (a, b) = (numbers(&filtered), numbers(&expected));
                a.iter().zip(b).all(|(a, b)| (a.wrapping_sub(b) as i16).abs() <= 1)
            }
        };
        assert!(same, "{stored}: {filtered:02x?} for {expected:02x?}");
    }
}

#[test]
fn what_is_cut_or_wild_is_refused() {
    for (stride, expected, streams) in attribute_streams() {
        let count = expected.len() / stride;
        for stream in streams.map(bytes) {
            for length in 0..stream.len() {
                assert!(attributes::decode(&stream[..length], count, stride).is_err(), "{length}");
            }
            // A few more are read where their differences are 0 and take no room.
            assert!(attributes::decode(&stream, 1 << 16, stride).is_err());
            assert!(attributes::decode(&[&stream[..], &[0]].concat(), count, stride).is_err());
        }
    }
    for (expected, stream) in triangles() {
        let stream = bytes(stream);
        for length in 0..stream.len() {
            assert!(indices::triangles(&stream[..length], expected.len(), 4).is_err(), "{length}");
        }
        for other in [0, expected.len() - 3, expected.len() + 3, 3 << 30] {
            assert!(indices::triangles(&stream, other, 4).is_err(), "{other}");
        }
    }
    let stream = bytes(SEQUENCE);
    for length in 0..stream.len() {
        assert!(indices::indices(&stream[..length], INDICES.len(), 4).is_err(), "{length}");
    }
    for other in [0, 12, 14, 1 << 40] {
        assert!(indices::indices(&stream, other, 4).is_err(), "{other}");
    }
}

/// Whatever a byte is changed to, decoding ends without a panic.
#[test]
fn damaged_bytes_do_no_harm() {
    let damaged = |stream: &str, decode: &dyn Fn(&[u8]) -> bool| {
        let stream = bytes(stream);
        let mut refused = 0;
        for place in 0..stream.len() {
            for value in [0, 1, 0x7f, 0x80, 0xf0, 0xff, stream[place] ^ 1] {
                let mut stream = stream.clone();
                stream[place] = value;
                refused += usize::from(!decode(&stream));
            }
        }
        assert!(refused > 0);
    };
    for (stride, expected, streams) in attribute_streams() {
        for stream in streams {
            let count = expected.len() / stride;
            damaged(stream, &|bytes| attributes::decode(bytes, count, stride).is_ok());
        }
    }
    for (expected, stream) in triangles() {
        damaged(stream, &|bytes| indices::triangles(bytes, expected.len(), 4).is_ok());
    }
    damaged(SEQUENCE, &|bytes| indices::indices(bytes, INDICES.len(), 4).is_ok());
    // Wild numbers in all filters.
    for filter in [Filter::Octahedral, Filter::Quaternion, Filter::Exponential, Filter::Color] {
        for stride in [4, 8].into_iter().filter(|stride| filter.fits(*stride)) {
            let mut wild: Vec<u8> = (0..4096u32).map(|i| ((i * i * 31) >> 3) as u8).collect();
            wild.extend([0; 16].into_iter().chain([255; 16]).chain([128; 16]));
            filter.apply(&mut wild, stride);
        }
    }
}
