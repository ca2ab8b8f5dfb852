//! Whole files: created, opened, saved, damaged.
#![allow(clippy::unwrap_used, clippy::indexing_slicing)]

use super::*;
use crate::Place;

/// Two markers and a model output in eight frames; coordinates that 32-bit floats hold exactly.
fn walk(frames: usize) -> TakeBuilder {
    let output = Marker { role: Role::ModelOutput, ..Marker::new("S:LKneeAngles") };
    let mut b = TakeBuilder::new(vec![Marker::new("S:LKNE"), Marker::new("S:RKNE"), output], frames, 100.0);
    for f in 0..frames {
        let x = f as f64 * 0.5;
        b.set(f, 0, [x, 200.0, -300.25], Origin::Measured);
        b.set(f, 1, [x + 90.0, 210.0, 310.5], if f == 2 { Origin::Derived } else { Origin::Measured });
        b.set(f, 2, [0.0, 0.0, 0.0], Origin::Measured);
    }
    b
}

fn create(take: &Take) -> (Vec<u8>, Vec<Note>) {
    let (mut out, notes) = (Vec::new(), Notes::new());
    C3d.create(take, &mut out, &notes).unwrap();
    (out, notes.take())
}

fn open(bytes: &[u8]) -> Result<(Box<dyn Document>, Vec<Note>), FormatError> {
    let notes = Notes::new();
    C3d.open(bytes.to_vec(), &Stated::default(), &notes).map(|d| (d, notes.take()))
}

fn same(a: &Take, b: &Take) {
    assert_eq!((a.frames(), &a.markers, a.first_frame, a.unit, a.rate_hz), (b.frames(), &b.markers, b.first_frame, b.unit, b.rate_hz));
    assert_eq!(a.up.map(|u| u.to_string()), b.up.map(|u| u.to_string()));
    for f in 0..a.frames() {
        for m in 0..a.markers.len() {
            assert_eq!((a.origin(f, m), a.position_mm(f, m)), (b.origin(f, m), b.position_mm(f, m)), "frame {f}, column {m}");
        }
    }
}

#[test]
fn what_is_created_opens_as_it_was() {
    for unit in Unit::ALL {
        let mut b = walk(8).first_frame(40).unit(unit).up(Some(Direction::PLUS_Y));
        b.hide(3, 0);
        let take = b.build();
        let (bytes, notes) = create(&take);
        assert_eq!(notes, []);
        assert_eq!(C3d.sniff(&bytes), Match::Certain);
        let (document, notes) = open(&bytes).unwrap();
        assert_eq!(notes, [Note::ModelOutputs { columns: 1 }]);
        if unit == Unit::Millimetre {
            same(document.take(), &take);
        }
        for f in 0..8 {
            assert_eq!(document.take().origin(f, 1), take.origin(f, 1));
            for m in 0..2 {
                let (a, b) = (document.take().position_mm(f, m), take.position_mm(f, m));
                assert_eq!(a.is_some(), b.is_some());
                let apart = a.unwrap_or([0.0; 3]).iter().zip(b.unwrap_or([0.0; 3])).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart <= document.rounding_mm(), "{apart}");
            }
        }
    }
}

#[test]
fn a_repair_changes_the_filled_samples_and_no_other_byte() {
    let mut b = walk(8);
    b.hide(3, 0);
    b.hide(4, 1);
    let (bytes, _) = create(&b.build());
    let (document, _) = open(&bytes).unwrap();
    let mut repaired = document.take().clone();
    assert!(repaired.fill(3, 0, [1.5, 2.5, 3.5]) && repaired.fill(4, 1, [0.0; 3]));
    let (mut out, notes) = (Vec::new(), Notes::new());
    document.save(&repaired, &mut out, &notes).unwrap();
    assert_eq!((out.len(), notes.take()), (bytes.len(), vec![]));
    let data = bytes.len() - 8 * 3 * 16;
    let changed: Vec<usize> = (0..out.len()).filter(|&i| out[i] != bytes[i]).map(|i| (i - data) / 16).collect();
    assert!(changed.iter().all(|&sample| sample == 3 * 3 || sample == 4 * 3 + 1), "{changed:?}");
    let (again, _) = open(&out).unwrap();
    assert_eq!((again.take().origin(3, 0), again.take().position_mm(3, 0)), (Origin::Derived, Some([1.5, 2.5, 3.5])));
    assert_eq!(again.take().origin(4, 1), Origin::Derived, "a sample filled at the origin must not read as missing");
    let apart = again.take().position_mm(4, 1).unwrap().iter().map(|x| x.abs()).fold(0.0, f64::max);
    assert!(apart <= document.rounding_mm());
}

#[test]
fn a_new_file_says_who_filled_it() {
    let mut b = walk(8);
    b.hide(3, 0);
    b.hide(4, 1);
    let mut take = b.build();
    assert!(take.fill(3, 0, [1.5, 2.5, 3.5]));
    take.filled_by = Some("lds".to_owned());
    let (bytes, _) = create(&take);
    let (again, _) = create(&take);
    assert_eq!(bytes, again, "no dates");
    let p = Parameters::read(&bytes, &Notes::new()).unwrap();
    assert_eq!(p.texts("MOCAPREPAIR", "VERSION").unwrap(), [env!("CARGO_PKG_VERSION")]);
    assert_eq!(p.texts("MOCAPREPAIR", "METHOD").unwrap(), ["lds"]);
    assert_eq!(p.number("MOCAPREPAIR", "FILLED"), Some(1.0));
    for (group, name) in [("ANALOG", "SCALE"), ("ANALOG", "OFFSET"), ("FORCE_PLATFORM", "CORNERS"), ("FORCE_PLATFORM", "TYPE")] {
        assert!(p.numbers(group, name, 1).is_empty(), "{group}:{name}");
    }
    assert!(Parameters::read(&create(&walk(1).build()).0, &Notes::new()).unwrap().texts("MOCAPREPAIR", "METHOD").is_none());
}

#[test]
fn events_of_the_header_and_other_groups_are_beyond_a_take() {
    let (mut bytes, _) = create(&walk(8).build());
    let beyond = |bytes: &[u8]| open(bytes).unwrap().0.beyond_take();
    assert!(beyond(&bytes).is_empty(), "our own group says nothing if nothing was filled");
    // word 150 is the key, word 151 counts
    bytes[300] = 3;
    assert_eq!(beyond(&bytes), ["3 events in the header"]);
    bytes[300] = 19;
    assert!(beyond(&bytes).is_empty(), "there is room for 18");
    bytes[298..302].copy_from_slice(&[0, 0, 3, 0]);
    assert!(beyond(&bytes).is_empty(), "without the key");
    let mut b = walk(8);
    b.hide(3, 0);
    let mut take = b.build();
    assert!(take.fill(3, 0, [1.5, 2.5, 3.5]));
    assert!(beyond(&create(&take).0).contains(&"the parameters of MOCAPREPAIR".to_owned()));
}

/// An Intel file of integers: one point, `samples` frames, step 0.1 mm.
fn integers(samples: &[[i16; 4]]) -> Vec<u8> {
    let mut b = TakeBuilder::new(vec![Marker::new("A")], samples.len(), 50.0);
    b.set(0, 0, [1.0, 1.0, 1.0], Origin::Measured);
    let (mut bytes, _) = create(&b.build());
    bytes.truncate(bytes.len() - samples.len() * 16);
    let at = bytes.windows(5).position(|w| w == b"SCALE").unwrap() + 5 + 4;
    bytes[at..at + 4].copy_from_slice(&0.1f32.to_le_bytes());
    bytes[12..16].copy_from_slice(&0.1f32.to_le_bytes());
    bytes.extend(samples.iter().flatten().flat_map(|w| w.to_le_bytes()));
    bytes
}

#[test]
fn integers_are_rounded_and_never_wrapped() {
    let bytes = integers(&[[10, 20, 30, 1], [0, 0, 0, -1], [0, 0, 0, -1], [40, 50, 60, 0x301]]);
    let (document, notes) = open(&bytes).unwrap();
    assert_eq!(notes, []);
    let scale = f64::from(0.1f32);
    assert_eq!(document.take().position_mm(0, 0), Some([10.0 * scale, 20.0 * scale, 30.0 * scale]));
    let mut repaired = document.take().clone();
    repaired.fill(1, 0, [2.04, -2.06, 0.0]);
    repaired.fill(2, 0, [0.01, 0.0, -0.04]);
    let (mut out, notes) = (Vec::new(), Notes::new());
    document.save(&repaired, &mut out, &notes).unwrap();
    assert_eq!(notes.take(), [Note::Rounded { step_mm: scale }]);
    assert_eq!(out, integers(&[[10, 20, 30, 1], [20, -21, 0, 0], [1, 0, 0, 0], [40, 50, 60, 0x301]]));

    let mut far = document.take().clone();
    far.fill(2, 0, [0.0, -3276.9, 0.0]);
    let mut out = Vec::new();
    let error = document.save(&far, &mut out, &Notes::new()).unwrap_err().to_string();
    assert!(
        error.contains("the filled y of A in frame 3 is -3276.9 mm, beyond the \u{b1}3276.7 mm") && error.contains("--float"),
        "{error}"
    );
    assert!(out.is_empty(), "nothing is written before all is known to fit");
}

#[test]
fn integers_become_floats_and_hold_what_integers_could_not() {
    let bytes = integers(&[[10, 20, -30, 1], [7, 8, 9, -1], [0, 0, 0, -32768], [32767, 50, 60, 0x301], [1, 0, 0, 0]]);
    let (document, notes) = open(&bytes).unwrap();
    let floats = document.as_floats().unwrap().unwrap();
    assert_eq!(floats.len(), bytes.len() + 5 * 8);
    let changed: Vec<usize> = (0..bytes.len() - 5 * 8).filter(|&i| floats[i] != bytes[i]).collect();
    assert_eq!(changed.len(), 2, "the signs of two scales: {changed:?}");
    let scale = f64::from(0.1f32);
    let words: Vec<f32> = floats[bytes.len() - 5 * 8..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    assert_eq!(
        words[..8],
        [
            (10.0 * scale) as f32,
            (20.0 * scale) as f32,
            (-30.0 * scale) as f32,
            1.0,
            (7.0 * scale) as f32,
            (8.0 * scale) as f32,
            (9.0 * scale) as f32,
            -1.0
        ]
    );
    assert_eq!([words[11], words[15], words[19]], [-32768.0, 769.0, 0.0]);

    let (again, notes_again) = open(&floats).unwrap();
    assert_eq!(notes, notes_again);
    assert!(again.as_floats().unwrap().is_none(), "these are floats");
    for f in 0..5 {
        assert_eq!(again.take().origin(f, 0), document.take().origin(f, 0));
    }
    let mut far = again.take().clone();
    assert!(far.fill(2, 0, [0.0, -3276.9, 1e6]));
    let mut out = Vec::new();
    again.save(&far, &mut out, &Notes::new()).unwrap();
    assert_eq!(open(&out).unwrap().0.take().position_mm(2, 0), Some([0.0, f64::from(-3276.9f32), 1e6]));
}

#[test]
fn what_was_stated_overrules() {
    let (bytes, _) = create(&walk(2).build());
    let stated = Stated { rate_hz: Some(12.5), unit: Some(Unit::Metre), ..Stated::default() };
    let document = C3d.open(bytes, &stated, &Notes::new()).unwrap();
    assert_eq!((document.take().rate_hz, document.take().unit), (12.5, Unit::Metre));
    assert_eq!(document.take().position_mm(0, 0), Some([0.0, 200_000.0, -300_250.0]));
}

#[test]
fn more_than_65535_frames_and_frame_numbers_beyond_16_bits() {
    for (frames, first) in [(65_535, 1), (65_536, 1), (70_000, 1), (10, 65_530), (10, 70_000), (70_000, 5)] {
        let mut b = TakeBuilder::new(vec![Marker::new("A")], frames, 100.0).first_frame(first);
        (0..frames).for_each(|f| b.set(f, 0, [f as f64, 1.0, 2.0], Origin::Measured));
        let take = b.build();
        let (bytes, notes) = create(&take);
        assert_eq!(notes, []);
        let (document, notes) = open(&bytes).unwrap();
        assert_eq!(notes, [], "{frames} from {first}");
        same(document.take(), &take);
        let cut = open(&bytes[..bytes.len() - 16]).unwrap();
        assert_eq!(cut.1, [Note::FrameCount { claimed: frames as u64, present: frames as u64 - 1 }]);
        assert!(open(&bytes[..bytes.len() - 15]).is_err());
    }
}

#[test]
fn counts_that_ran_over_are_completed_from_the_size_of_the_file() {
    let frames = 70_000usize;
    let mut b = TakeBuilder::new(vec![Marker::new("A")], frames, 100.0);
    (0..frames).for_each(|f| b.set(f, 0, [1.0, 2.0, 3.0], Origin::Measured));
    let (bytes, _) = create(&b.build());
    let set = |count: u16| {
        let mut bytes = bytes.clone();
        // Without LONG_FRAMES and TRIAL nothing but the 16-bit counts is left.
        for name in [&b"LONG_FRAMES"[..], b"ACTUAL_START_FIELD"] {
            let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
            bytes[at] = b'_';
        }
        let at = bytes.windows(8).position(|w| w == b"\x06\x01FRAMES").unwrap() + 8 + 4;
        bytes[at..at + 2].copy_from_slice(&count.to_le_bytes());
        bytes[8..10].copy_from_slice(&count.to_le_bytes());
        bytes
    };
    let (saturated, notes) = open(&set(0xffff)).unwrap();
    assert_eq!((saturated.take().frames(), notes), (frames, vec![Note::FrameCount { claimed: 65_535, present: 70_000 }]));
    let (wrapped, notes) = open(&set((frames % 65_536) as u16)).unwrap();
    assert_eq!((wrapped.take().frames(), notes), (frames, vec![]), "70000 modulo 65536");
}

#[test]
fn hundreds_of_long_labels_and_what_has_no_room() {
    let markers: Vec<Marker> = (0..700).map(|i| Marker::new(format!("{i:0>60}\u{e4}"))).collect();
    let mut b = TakeBuilder::new(markers, 2, 100.0);
    b.set(1, 699, [1.0, 2.0, 3.0], Origin::Measured);
    let take = b.build();
    let (bytes, notes) = create(&take);
    assert_eq!(notes, []);
    same(open(&bytes).unwrap().0.take(), &take);

    let long = TakeBuilder::new(vec![Marker::new("\u{e4}".repeat(200))], 1, 100.0).first_frame(-4).build();
    let (bytes, notes) = create(&long);
    let texts: Vec<String> = notes.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "c3d cannot hold the end of 1 labels that are longer than 255 bytes; left out",
            "c3d cannot hold a first frame of number -4; left out"
        ]
    );
    assert_eq!(open(&bytes).unwrap().0.take().markers[0].label, "\u{e4}".repeat(127));

    let unnamed = TakeBuilder::new(vec![Marker { role: Role::ModelOutput, ..Marker::new("") }], 1, 100.0).build();
    assert!(matches!(create(&unnamed).1[..], [Note::NotExpressible { .. }]));

    let far = {
        let mut b = TakeBuilder::new(vec![Marker::new("A")], 1, 100.0);
        b.set(0, 0, [1e300, 0.0, 0.0], Origin::Measured);
        b.build()
    };
    assert!(C3d.create(&far, &mut Vec::new(), &Notes::new()).unwrap_err().to_string().contains("too far away"));
    let many = TakeBuilder::new(vec![Marker::new(""); 70_000], 0, 100.0).build();
    assert!(C3d.create(&many, &mut Vec::new(), &Notes::new()).unwrap_err().to_string().contains("70000 markers"));
}

#[test]
fn nothing_at_all() {
    for (markers, frames) in [(0, 0), (0, 5), (3, 0)] {
        let take = TakeBuilder::new(vec![Marker::new("A"); markers], frames, 100.0).build();
        let (document, _) = open(&create(&take).0).unwrap();
        assert_eq!((document.take().markers.len(), document.take().frames()), (markers, frames));
    }
}

#[test]
fn sniffing() {
    let (bytes, _) = create(&walk(1).build());
    assert_eq!(C3d.sniff(&bytes), Match::Certain);
    assert_eq!(C3d.sniff(&bytes[..300]), Match::Maybe, "the processor is not in sight");
    assert_eq!(C3d.sniff(b"LPSI-x,LPSI-y\n"), Match::No);
    assert_eq!(C3d.sniff(b"\x02"), Match::No);
}

#[test]
fn an_error_says_where() {
    let (bytes, _) = create(&walk(8).build());
    let error = open(&bytes[..bytes.len() - 1]).err().unwrap();
    assert_eq!(error.place, Place::Byte { offset: bytes.len() as u64 - 48, section: "points" });
    assert_eq!(
        error.to_string(),
        format!(
            "c3d: the file ends in frame 8 of 8, 47 of its 48 bytes are there: it is cut off; copy or export it again (points, byte {:#x})",
            bytes.len() - 48
        )
    );
}

/// xorshift64*: any seed but 0.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % n
    }
}

#[test]
fn damage_never_panics_and_never_invents() {
    let mut random = Random(0x6d6f_6361_7021);
    let mut b = walk(20);
    b.hide(3, 0);
    let float = create(&b.build()).0;
    let integer = integers(&[[10, 20, 30, 1], [0, 0, 0, -1], [40, 50, 60, 0x301]]);
    let mut opened = 0;
    for round in 0..20_000 {
        let mut bytes = if round % 2 == 0 { float.clone() } else { integer.clone() };
        for _ in 0..=random.below(8) {
            // Most of the meaning is in the first two blocks.
            let at = if random.below(4) == 0 { random.below(bytes.len()) } else { random.below(1024) };
            bytes[at] = match random.below(4) {
                0 => 0,
                1 => 0xff,
                2 => bytes[at] ^ (1 << random.below(8)),
                _ => random.below(256) as u8,
            };
        }
        if random.below(4) == 0 {
            bytes.truncate(random.below(bytes.len()));
        }
        let Ok((document, _)) = open(&bytes) else { continue };
        opened += 1;
        let take = document.take();
        assert!(take.frames() * take.markers.len() * 8 <= bytes.len(), "more samples than bytes");
        let mut out = Vec::new();
        document.save(take, &mut out, &Notes::new()).unwrap();
        assert!(out == bytes, "an unchanged take changes nothing");
        let mut repaired = take.clone();
        for f in 0..take.frames() {
            for m in 0..take.markers.len() {
                repaired.fill(f, m, [1.0, 2.0, 3.0]);
            }
        }
        let mut out = Vec::new();
        if document.save(&repaired, &mut out, &Notes::new()).is_ok() {
            assert_eq!(out.len(), bytes.len());
        }
        let _ = C3d.create(take, &mut Vec::new(), &Notes::new());
        if let Ok(Some(floats)) = document.as_floats() {
            let again = open(&floats).unwrap().0;
            assert_eq!((again.take().frames(), again.take().markers.len()), (take.frames(), take.markers.len()));
        }
    }
    assert!(opened > 2000, "only {opened} of the damaged files opened: this test sees too little");
}

#[test]
fn every_cut_is_an_error_or_noted() {
    let take = walk(8).build();
    let (bytes, _) = create(&take);
    for length in 0..bytes.len() {
        if let Ok((document, notes)) = open(&bytes[..length]) {
            let present = document.take().frames();
            assert!(notes.contains(&Note::FrameCount { claimed: 8, present: present as u64 }) && present < 8, "cut to {length} bytes");
            assert_eq!((bytes.len() - length) % 48, 0);
        }
    }
}

#[test]
fn model_outputs_have_no_unit_of_length() {
    let markers = vec![Marker::new("A"), Marker { label: "LKneeAngles".into(), role: Role::ModelOutput }];
    for unit in Unit::ALL {
        let mut b = TakeBuilder::new(markers.clone(), 1, 100.0).unit(unit);
        b.set(0, 0, [1000.0, 2000.0, 3000.0], Origin::Measured);
        b.set(0, 1, [45.5, -3.25, 0.0], Origin::Measured);
        let mut bytes = Vec::new();
        C3d.create(&b.build(), &mut bytes, &Notes::new()).unwrap();
        let bytes_45: Vec<u8> = 45.5_f32.to_le_bytes().to_vec();
        assert!(bytes.windows(4).any(|w| w == bytes_45), "{unit:?}: another reader finds degrees");
        let document = C3d.open(bytes, &Stated::default(), &Notes::new()).unwrap();
        assert_eq!(document.take().position_mm(0, 1), Some([45.5, -3.25, 0.0]), "{unit:?}");
        assert_eq!(document.take().position_mm(0, 0), Some([1000.0, 2000.0, 3000.0]), "{unit:?}");
    }
}
