use super::*;

fn checkpoint() -> Checkpoint {
    let header = Header {
        engine: env!("CARGO_PKG_VERSION").into(),
        method: "stochastic".into(),
        format: 1,
        scene: "00".into(),
        settings: BTreeMap::from([("resolution".into(), "256".into())]),
        seed: u64::MAX,
        decided: BTreeMap::new(),
        view: ViewKey { camera: vec![1, 2, 3], width: 4, height: 5, background: vec![] },
        iterations: 6,
        shots: 7,
        light_shots: 8,
        seconds: 0.1,
        estimated_error: None,
    };
    let mut shared = Writer::new(1 << 20);
    shared.slice(&[1.5f32, f32::NAN, -0.0]);
    shared.value(7u64);
    let bound = (0..200u8).collect();
    Checkpoint::new(header, shared.finish().expect("room"), bound)
}

#[test]
fn bytes_come_back() {
    let one = checkpoint();
    let other = Checkpoint::from_bytes(&one.to_bytes()).expect("whole");
    assert_eq!(one, other);
    let mut shared = other.shared();
    let values: Vec<f32> = shared.exactly(3).expect("three");
    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&values), bits(&[1.5, f32::NAN, -0.0]));
    assert_eq!(shared.value::<u64>().expect("a number"), 7);
    shared.end().expect("nothing left");
}

/// Wherever a bit is turned over and wherever the end is cut off.
#[test]
fn no_changed_byte_goes_unseen() {
    let bytes = checkpoint().to_bytes();
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        Checkpoint::from_bytes(&changed).expect_err("a changed byte");
        Checkpoint::from_bytes(&bytes[..at]).expect_err("a missing end");
    }
    let longer = [&bytes[..], &[0]].concat();
    Checkpoint::from_bytes(&longer).expect_err("a byte too many");
}

#[test]
fn lengths_that_lie_are_not_believed() {
    for count in [4, u64::MAX, u64::MAX / 4, 1 << 40] {
        let bytes = [&count.to_le_bytes()[..], &[0; 12]].concat();
        Reader::new(&bytes).slice::<f32>().expect_err("longer than the bytes");
        Reader::new(&bytes).exactly::<f32>(3).expect_err("not three");
    }
    let mut writer = Writer::new(10);
    writer.slice(&[0u32; 1]);
    assert_eq!(writer.finish(), None, "more than the room");
}

#[test]
fn another_format_is_told_from_damage() {
    let mut bytes = checkpoint().to_bytes();
    bytes[8] ^= 2;
    let sum = crc32fast::hash(&bytes[..PREAMBLE - 4]).to_le_bytes();
    bytes[PREAMBLE - 4..PREAMBLE].copy_from_slice(&sum);
    let error = Checkpoint::from_bytes(&bytes).expect_err("another format");
    assert!(matches!(error, CheckpointError::Version { .. }), "{error}");
}
