//! A created file opens as the take that it was made from.

use crate::cases;
use formats::{Direction, Format, Marker, Note, Notes, Origin, Stated, Take, TakeBuilder, Unit};
use proptest::prelude::*;

/// Labels as people and programs write them, with what separates, quotes and translates; without blanks at their ends, which no format keeps.
fn label() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => "[A-Z][A-Z0-9]{2,4}",
        2 => "[A-Za-z]{1,8}:[A-Z0-9]{1,6}",
        2 => "[!-~]( ?[!-~]){0,10}",
        1 => "[äöüÄßéñµ左膝]{1,6}",
        1 => "[a-c]{1,2}[\n\t\u{1b}][a-c]{1,2}",
        1 => "[A-Z]{1,3}(Force|Angles|Moment|Powers)",
        1 => Just(String::new()),
    ]
}

/// A take of any kind: one frame or some, none or all of its samples missing, any rate, unit and first frame.
fn takes() -> impl Strategy<Value = Take> {
    let rate = prop_oneof![
        prop::sample::select(vec![24.0, 25.0, 29.97, 30.0, 50.0, 59.94, 60.0, 100.0, 119.88, 120.0, 200.0, 240.0, 300.0, 1000.0, 0.5]),
        1.0..2000.0_f64,
    ];
    let up = prop_oneof![Just(None), (0..3_usize, any::<bool>()).prop_map(|(axis, positive)| Some(Direction { axis, positive }))];
    let first = prop_oneof![Just(1_i64), 0..100_000_i64, -100_000..0_i64, Just(4_000_000_000)];
    (prop::collection::vec(label(), 1..8), 1..=12_usize, rate, prop::sample::select(Unit::ALL.to_vec()), up, first, 0.0..1.2, 1..u64::MAX)
        .prop_map(|(labels, frames, rate_hz, unit, up, first, missing, mut seed)| {
            let count = labels.len();
            let markers = labels.into_iter().map(Marker::new).collect();
            let mut take = TakeBuilder::new(markers, frames, rate_hz).unit(unit).up(up).first_frame(first);
            let mut unit_random = || {
                // xorshift: the samples of a take are not worth shrinking
                seed ^= seed << 13;
                seed ^= seed >> 7;
                seed ^= seed << 17;
                (seed >> 11) as f64 / (1_u64 << 53) as f64
            };
            for frame in 0..frames {
                for marker in 0..count {
                    let origin = if unit_random() < 0.8 { Origin::Measured } else { Origin::Derived };
                    let position = std::array::from_fn(|_| 6000.0 * unit_random() - 3000.0);
                    if unit_random() >= missing {
                        take.set(frame, marker, position, origin);
                    }
                }
            }
            take.build()
        })
}

fn through(format: &dyn Format, take: &Take) -> (Take, Vec<Note>) {
    let (mut bytes, notes) = (Vec::new(), Notes::new());
    format.create(take, &mut bytes, &notes).unwrap();
    let opened = format.open(bytes, &Stated::default(), &notes).unwrap();
    (opened.take().clone(), notes.take())
}

/// Asserts that `back` is `take`, with coordinates off by at most `relative` of themselves.
fn same(take: &Take, back: &Take, relative: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(&back.markers, &take.markers);
    prop_assert_eq!((back.frames(), back.first_frame, back.unit), (take.frames(), take.first_frame, take.unit));
    for frame in 0..take.frames() {
        for marker in 0..take.markers.len() {
            match (take.position_mm(frame, marker), back.position_mm(frame, marker)) {
                (None, None) => {}
                (Some(p), Some(q)) => {
                    prop_assert!((0..3).all(|axis| (p[axis] - q[axis]).abs() <= relative * p[axis].abs()), "{:?} comes back as {:?}", p, q);
                }
                other => prop_assert!(false, "frame {}, marker {}: {:?}", frame, marker, other),
            }
        }
    }
    Ok(())
}

/// The take with the labels that `back` has in place of those that a header cannot hold; that there are any must have been noted.
fn renamed(take: &Take, back: &Take, notes: &[Note]) -> Result<Take, TestCaseError> {
    let mut renamed = take.clone();
    let odd = |label: &str| label.is_empty() || label.contains(char::is_control);
    for (marker, now) in renamed.markers.iter_mut().zip(&back.markers).filter(|(m, now)| odd(&m.label) && m.label != now.label) {
        let plain: String = marker.label.chars().map(|c| if c.is_control() { '_' } else { c }).collect();
        let plain = if plain.is_empty() { "unlabelled_" } else { plain.as_str() };
        prop_assert!(now.label.starts_with(plain), "{}", now.label);
        prop_assert_eq!(back.markers.iter().filter(|m| m.label == now.label).count(), 1, "{}", now.label);
        let told = notes.iter().any(|n| matches!(n, Note::Changed { what, .. } if what.contains("labels that ")));
        prop_assert!(told, "{:?}", notes);
        marker.label.clone_from(&now.label);
    }
    Ok(renamed)
}

/// True if a note says that the format cannot hold this.
fn lost(notes: &[Note], what: &str) -> bool {
    notes.iter().any(|n| matches!(n, Note::NotExpressible { what: w, .. } if w.contains(what)))
}

proptest! {
    #![proptest_config(cases(64))]

    /// Coordinates and rates are 32-bit floats: two roundings of half a step, 2⁻²⁴ each, because units other than mm divide first.
    #[test]
    fn a_c3d_opens_as_the_take_it_was_made_from(take in takes()) {
        let (back, notes) = through(&formats::c3d::C3d, &take);
        // frame numbers are unsigned
        let take = if lost(&notes, "a first frame of number") { TakeBuilder::from(take).first_frame(1).build() } else { take };
        prop_assert!(take.first_frame >= 0);
        same(&take, &back, 1.2e-7)?;
        prop_assert!((back.rate_hz / take.rate_hz - 1.0).abs() <= 6e-8, "{} Hz comes back as {}", take.rate_hz, back.rate_hz);
        prop_assert_eq!(back.up, take.up);
        // the fourth word tells measured from derived as long as anything was measured
        let cells = || (0..take.frames()).flat_map(|f| (0..take.markers.len()).map(move |m| (f, m)));
        if cells().any(|(f, m)| take.origin(f, m) == Origin::Measured) {
            for (f, m) in cells() {
                prop_assert_eq!(back.origin(f, m), take.origin(f, m));
            }
        }
    }

    /// Numbers have as many digits as it takes, so they come back exactly; both name rate and unit.
    #[test]
    fn exports_open_as_the_take_they_were_made_from(take in takes()) {
        for format in [&formats::motive::Motive as &dyn Format, &formats::nexus::Nexus] {
            let (back, notes) = through(format, &take);
            same(&renamed(&take, &back, &notes)?, &back, f64::EPSILON)?;
            prop_assert_eq!(back.rate_hz, take.rate_hz);
            let silent = |what: &str| !lost(&notes, what);
            let derived = (0..take.frames()).any(|f| (0..take.markers.len()).any(|m| take.origin(f, m) == Origin::Derived));
            prop_assert_eq!((silent("points up"), silent("filled or filtered")), (take.up.is_none(), !derived));
            let others = notes.iter().filter(|n| n.matters() && !matches!(n, Note::NotExpressible { .. } | Note::Changed { .. })).count();
            prop_assert_eq!(others, 0, "{:?}", notes);
        }
    }

    /// Numbers and the rate have as many digits as it takes. Labels that the header cannot hold are changed, and that is said.
    #[test]
    fn a_trc_opens_as_the_take_it_was_made_from(take in takes()) {
        let (back, notes) = through(&formats::trc::Trc, &take);
        let renamed = renamed(&take, &back, &notes)?;
        same(&renamed, &back, f64::EPSILON)?;
        prop_assert_eq!(back.rate_hz, take.rate_hz);
    }

    /// The same, and always in millimetres.
    #[test]
    fn a_tsv_opens_as_the_take_it_was_made_from(take in takes()) {
        let (back, notes) = through(&formats::tsv::Tsv, &take);
        let renamed = renamed(&take, &back, &notes)?;
        same(&TakeBuilder::from(renamed).unit(Unit::Millimetre).build(), &back, 0.0)?;
        let changed = notes.iter().any(|n| matches!(n, Note::Changed { what, .. } if what.starts_with("lengths are written in mm")));
        prop_assert_eq!(changed, take.unit != Unit::Millimetre);
        prop_assert_eq!(back.rate_hz, take.rate_hz);
    }

    /// Numbers have as many digits as it takes, so they come back exactly.
    #[test]
    fn a_csv_opens_as_the_take_it_was_made_from(take in takes()) {
        let (back, notes) = through(&formats::csv::Csv, &take);
        same(&take, &back, f64::EPSILON)?;
        // one frame has no rate, and that is said
        let told = |n: &Note| matches!(n, Note::RateAssumed { .. });
        prop_assert_eq!((lost(&notes, "the frame rate"), notes.iter().any(told)), (take.frames() < 2, take.frames() < 2));
        if take.frames() > 1 {
            prop_assert!((back.rate_hz / take.rate_hz - 1.0).abs() <= 1e-12, "{} Hz comes back as {}", take.rate_hz, back.rate_hz);
        }
        // what a table cannot say is said aloud
        let silent = |what: &str| !lost(&notes, what);
        let derived = (0..take.frames()).any(|f| (0..take.markers.len()).any(|m| take.origin(f, m) == Origin::Derived));
        prop_assert_eq!((silent("points up"), silent("filled or filtered")), (take.up.is_none(), !derived));
    }

    /// The same for a row for each sample, which has no rows without a label, and knows markers by their labels.
    #[test]
    fn a_long_csv_opens_as_the_take_it_was_made_from(take in takes()) {
        let mut labels: Vec<&str> = take.markers.iter().map(|m| m.label.as_str()).collect();
        labels.sort_unstable();
        labels.dedup();
        prop_assume!(labels.len() == take.markers.len());
        let (mut bytes, notes) = (Vec::new(), Notes::new());
        formats::csv::create_long(&take, &mut bytes, &notes).unwrap();
        let opened = formats::csv::Csv.open(bytes, &Stated::default(), &notes).unwrap();
        same(&take, opened.take(), f64::EPSILON)?;
    }

    /// Positions come back exactly where there are some; what BVH cannot say is said aloud.
    #[test]
    fn a_bvh_opens_as_the_take_it_was_made_from(take in takes()) {
        let (back, notes) = through(&formats::bvh::Bvh, &take);
        prop_assert_eq!((back.frames(), back.markers.len(), back.unit), (take.frames(), take.markers.len(), take.unit));
        prop_assert!((back.rate_hz / take.rate_hz - 1.0).abs() <= 1e-12, "{} Hz comes back as {}", take.rate_hz, back.rate_hz);
        let mut missing = 0;
        for frame in 0..take.frames() {
            for marker in 0..take.markers.len() {
                match take.position_mm(frame, marker) {
                    Some(p) => {
                        let q = back.position_mm(frame, marker).unwrap_or_default();
                        prop_assert!((0..3).all(|axis| (p[axis] - q[axis]).abs() <= f64::EPSILON * p[axis].abs()), "{:?} became {:?}", p, q);
                    }
                    None => missing += 1,
                }
            }
        }
        let said = |what: &str| lost(&notes, what);
        prop_assert_eq!(said("are missing") || said("never seen"), missing > 0);
        prop_assert_eq!((said("points up"), said("first frame")), (take.up.is_some(), take.first_frame != 1));
        let names: std::collections::BTreeSet<&str> = back.markers.iter().map(|m| m.label.as_str()).collect();
        prop_assert_eq!(names.len(), back.markers.len());
    }
}
