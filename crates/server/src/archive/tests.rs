use super::*;
use crate::worker::scenes::SceneRefusal;
use flate2::Compression;
use flate2::write::DeflateEncoder;
use std::io::{self, Read, Write};

const MOST: u64 = 1 << 20;

/// A member of an archive that is made byte by byte.
#[derive(Clone)]
struct Member {
    name: Vec<u8>,
    contents: Vec<u8>,
    flags: u16,
    method: u16,
    /// Mode of Unix; 0 for an archive of another system.
    mode: u32,
    /// What the directory says of its size, where that is not true.
    claimed: Option<u32>,
    extra: Vec<u8>,
}

fn member(name: &str, contents: &[u8]) -> Member {
    let (name, contents) = (name.as_bytes().to_vec(), contents.to_vec());
    Member { name, contents, flags: 0, method: 8, mode: 0, claimed: None, extra: Vec::new() }
}

fn archive(members: &[Member]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for member in members {
        let mut deflated = DeflateEncoder::new(Vec::new(), Compression::best());
        deflated.write_all(&member.contents).unwrap();
        let packed = match member.method {
            8 => deflated.finish().unwrap(),
            _ => member.contents.clone(),
        };
        let mut crc = crc32fast::Hasher::new();
        crc.update(&member.contents);
        let size = member.claimed.unwrap_or(member.contents.len() as u32);
        let mut common = Vec::new();
        common.extend([20, 0]);
        for short in [member.flags, member.method, 0, 0] {
            common.extend(short.to_le_bytes());
        }
        for long in [crc.finalize(), packed.len() as u32, size] {
            common.extend(long.to_le_bytes());
        }
        common.extend((member.name.len() as u16).to_le_bytes());
        let header = bytes.len() as u32;
        bytes.extend(*b"PK\x03\x04");
        bytes.extend(&common);
        bytes.extend([0, 0]);
        bytes.extend(&member.name);
        bytes.extend(packed);
        directory.extend(*b"PK\x01\x02");
        directory.extend([20, if member.mode == 0 { 0 } else { 3 }]);
        directory.extend(&common);
        directory.extend((member.extra.len() as u16).to_le_bytes());
        directory.extend([0; 6]);
        directory.extend((member.mode << 16).to_le_bytes());
        directory.extend(header.to_le_bytes());
        directory.extend(&member.name);
        directory.extend(&member.extra);
    }
    let (begin, count) = (bytes.len() as u32, members.len() as u16);
    let size = directory.len() as u32;
    bytes.extend(directory);
    bytes.extend(*b"PK\x05\x06\0\0\0\0");
    bytes.extend(count.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend(size.to_le_bytes());
    bytes.extend(begin.to_le_bytes());
    bytes.extend([0, 0]);
    bytes
}

type Files = (Vec<u8>, BTreeMap<String, Vec<u8>>);

/// Everything that belongs to the scene of an archive, which lies in the middle of a file.
fn unpack(bytes: &[u8]) -> Result<Files, ArchiveError> {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(b"before").unwrap();
    file.write_all(bytes).unwrap();
    file.write_all(b"behind").unwrap();
    let stretch = Stretch { file: &file, start: 6, size: bytes.len() as u64 };
    let packed = Packed::open(stretch, MOST)?;
    let all = |(size, mut contents): (u64, Contents<'_>)| {
        let mut read = Vec::new();
        contents.read_to_end(&mut read).map(|_| assert_eq!(read.len() as u64, size))?;
        Ok::<_, io::Error>(read)
    };
    let main = all(packed.main())?;
    let resources = packed.resources().into_iter();
    let resources = resources.map(|(name, contents)| Ok((name, all(contents)?)));
    Ok((main, resources.collect::<io::Result<_>>()?))
}

fn refusal(bytes: &[u8]) -> SceneRefusal {
    match unpack(bytes) {
        Err(ArchiveError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_scene_is_found_with_what_lies_beside_it() {
    let members = [
        member("readme.txt", b"not the scene's"),
        member("room/scene.GLTF", b"{}"),
        member("room/./a.bin", &[7; 3000]),
        member("room\\textures\\wood.png", b"png"),
        member("room/textures/", b""),
        member("room/old/scene.glb", b"deeper"),
        member("__MACOSX/room/._scene.gltf", b"left behind"),
        member("room/.DS_Store", b"left behind"),
        Member { method: 0, mode: 0o100_644, ..member("room/b.bin", b"stored") },
        member("room/empty", b""),
    ];
    let (main, resources) = unpack(&archive(&members)).unwrap();
    assert_eq!(main, b"{}");
    let expected = [
        ("a.bin", vec![7; 3000]),
        ("b.bin", b"stored".to_vec()),
        ("empty", Vec::new()),
        ("old/scene.glb", b"deeper".to_vec()),
        ("textures/wood.png", b"png".to_vec()),
    ];
    assert_eq!(resources, expected.map(|(name, bytes)| (name.to_owned(), bytes)).into());
}

#[test]
fn names_are_read_in_any_script() {
    // As another program writes it: in UTF-8, with a comment at the end.
    const MADE: &str = "504b030414000008080000002150491f4f640e0000003b000000180000004dc3b662656c20e5aeb6e585b72f\
         537a656e652e676c7466ab564a54b25250aa201928d50200504b030414000008000000002150ccd35a510500\
         000005000000220000004dc3b662656c20e5aeb6e585b72f62696e2fd0b4d0b0d0bdd0bdd18bd0b52e62696e\
         0001020304504b0102140314000008080000002150491f4f640e0000003b0000001800000000000000000000\
         008001000000004dc3b662656c20e5aeb6e585b72f537a656e652e676c7466504b0102140314000008000000\
         002150ccd35a5105000000050000002200000000000000000000008001440000004dc3b662656c20e5aeb6e5\
         85b72f62696e2fd0b4d0b0d0bdd0bdd18bd0b52e62696e504b05060000000002000200960000008900000017\
         006d61646520627920616e6f746865722070726f6772616d";
    let digit = |byte: u8| (byte as char).to_digit(16).unwrap() as u8;
    let made: Vec<u8> =
        MADE.as_bytes().chunks(2).map(|pair| digit(pair[0]) << 4 | digit(pair[1])).collect();
    let (main, resources) = unpack(&made).unwrap();
    assert_eq!(main.len(), 59);
    assert_eq!(resources, [("bin/данные.bin".to_owned(), vec![0, 1, 2, 3, 4])].into());

    let mut old = member("scene.gltf", b"{}");
    let mut texture = member("", b"");
    texture.name = b"K\x81che.png".to_vec();
    let mut path = vec![0x75, 0x70, 5 + 6, 0, 1, 0, 0, 0, 0];
    path.extend("家具".as_bytes());
    let unicode = Member { name: b"??.png".to_vec(), extra: path, ..member("", b"") };
    old.flags = 1 << 11;
    let (_, resources) = unpack(&archive(&[old, texture, unicode])).unwrap();
    assert_eq!(resources.into_keys().collect::<Vec<_>>(), ["Küche.png", "家具"]);
}

#[test]
fn what_is_no_scene_or_no_plain_file_is_refused() {
    let scene = member("scene.gltf", b"{}");
    let beside = |other: Member| archive(&[scene.clone(), other]);
    for (bytes, at, what) in [
        (archive(&[]), "archive", "no .gltf and no .glb"),
        (archive(&[member("gltf", b"")]), "archive", "no .gltf and no .glb"),
        (beside(member("b.glb", b"")), "archive", "2 scenes in it: b.glb, scene.gltf"),
        (beside(member("../up.bin", b"")), "../up.bin", "leaves the folder"),
        (beside(member("a/..\\..\\up", b"")), "a/..\\..\\up", "leaves the folder"),
        (beside(member("/etc/passwd", b"")), "/etc/passwd", "absolute"),
        (beside(member("\\\\host\\x", b"")), "\\\\host\\x", "absolute"),
        (beside(member("C:\\x", b"")), "C:\\x", "absolute"),
        (beside(member("a\nb", b"")), "a\nb", "control character"),
        (beside(member("./", b"")), "archive", "without a name"),
        (beside(member("x/../y", b"")), "x/../y", "leaves"),
        (beside(member("./scene.gltf", b"")), "scene.gltf", "twice"),
        (beside(Member { flags: 1, ..member("x", b"") }), "x", "encrypted"),
        (beside(Member { method: 12, ..member("x", b"") }), "x", "method 12"),
        (beside(Member { mode: 0o120_777, ..member("x", b"/etc/passwd") }), "x", "a link"),
        (beside(Member { mode: 0o020_666, ..member("x", b"") }), "x", "no file"),
        (beside(Member { claimed: Some(3), ..member("x", b"four") }), "x", "more bytes"),
        (beside(Member { claimed: Some(5), ..member("x", b"four") }), "x", "fewer bytes"),
        (beside(Member { claimed: Some(u32::MAX), ..member("x", b"") }), "x", "zip64"),
        (b"PK\x03\x04 and no more".to_vec(), "archive", "no directory"),
    ] {
        let refusal = refusal(&bytes);
        assert!(refusal.at == at && refusal.what.contains(what), "{what}: {refusal}");
        assert!(!refusal.too_large);
    }
}

#[test]
fn bombs_are_refused_before_they_go_off() {
    // A member of a thousandth of what comes out of it, and one that says that it has less.
    let bomb = vec![0; MOST as usize + 1];
    assert!(refusal(&archive(&[member("scene.gltf", &bomb)])).too_large);
    let lying = Member { claimed: Some(10), ..member("scene.gltf", &bomb) };
    assert!(refusal(&archive(&[lying])).what.contains("more bytes"));
    // Many that are too much together, and more members than there may be.
    let half = member("scene.gltf", &vec![0; MOST as usize / 2]);
    let other = |index: usize| Member { name: format!("{index}").into_bytes(), ..half.clone() };
    assert!(unpack(&archive(&[half.clone(), other(1)])).is_ok());
    assert!(refusal(&archive(&[half.clone(), other(1), member("2", b"x")])).too_large);
    let many: Vec<Member> = (0..5000).map(|index| member(&format!("{index}"), b"")).collect();
    assert!(refusal(&archive(&many)).too_large);
}

#[test]
fn damage_is_seen() {
    let members = [member("scene.gltf", b"{ \"a\": [1, 2, 3] }"), member("a.bin", &[9; 100])];
    let whole = archive(&members);
    let expected = unpack(&whole).unwrap();
    for length in 0..whole.len() {
        refusal(&whole[..length]);
    }
    let mut refused = 0;
    for place in 0..whole.len() {
        for value in [0, 0x7f, 0xff, whole[place] ^ 1] {
            let mut bytes = whole.clone();
            bytes[place] = value;
            match unpack(&bytes) {
                Ok(_) => {}
                Err(ArchiveError::Refused(_)) => refused += 1,
                Err(ArchiveError::Trouble(error)) => panic!("{place} as {value}: {error}"),
            }
        }
    }
    assert!(refused > whole.len());
    // No damage to contents goes unseen.
    let at = 30 + "scene.gltf".len();
    let mut bytes = whole;
    bytes[at + 4] ^= 1;
    assert!(unpack(&bytes).is_err());
    assert_eq!(expected.0, members[0].contents);
}
