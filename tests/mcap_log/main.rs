//! The MCAP log: what a reader finds in it, and what is left on the disk when a run ends early.
#![allow(clippy::unwrap_used)] // a test that cannot open its own file has failed

mod frames;
mod page;

use formats::{Direction, Marker, Origin, Take, TakeBuilder};
use mocap_repair::log::{About, Attachment, Closing, LogError, METADATA, McapLog, Up, schema};
use mocap_repair::solve::{self, Bone, Estimate, Limits, Observer, Problem, Progress, SolveError, Solver};
use prost::Message;
use std::collections::BTreeMap;
use std::path::Path;

/// Three markers on a line at x = 0, 400 and 700 mm. LTIB is missing from frames 1 and 2, LANK from frame 2.
fn take() -> Take {
    let mut take = TakeBuilder::new(vec![Marker::new("S:LFEM"), Marker::new("S:LTIB"), Marker::new("S:LANK")], 4, 59.94);
    for frame in 0..4 {
        for (marker, x) in [0.0, 400.0, 700.0].into_iter().enumerate() {
            take.set(frame, marker, [x, 0.0, 1000.0], Origin::Measured);
        }
    }
    for (frame, marker) in [(1, 1), (2, 1), (2, 2)] {
        take.hide(frame, marker);
    }
    take.build()
}

fn problem() -> Problem {
    let bones = [
        Bone { a: 0, b: 1, length_mm: 400.0, spread_mm: 0.5 },
        Bone { a: 1, b: 2, length_mm: 300.0, spread_mm: 0.25 },
        Bone { a: 0, b: 1, length_mm: 400.0, spread_mm: 0.5 },
    ];
    Problem::new(&take(), &[true; 3], &bones)
}

/// A solver that has made up its mind: for each step, what it claims and how far from their places its samples are along x.
struct Script {
    name: &'static str,
    steps: Vec<(Option<f64>, Option<f64>, [f64; 3])>,
    taken: usize,
    estimate: Estimate,
}

impl Script {
    fn new(name: &'static str, steps: &[(Option<f64>, Option<f64>, [f64; 3])]) -> Self {
        Self { name, steps: steps.to_vec(), taken: 0, estimate: Estimate::open(3) }
    }
}

impl Solver for Script {
    fn name(&self) -> &'static str {
        self.name
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let Some(&(log_likelihood, rms_residual_mm, off)) = self.steps.get(self.taken) else {
            return Err(SolveError::Numerical("the script has ended".into()));
        };
        self.taken += 1;
        for ((position, place), off) in self.estimate.positions_mm.iter_mut().zip([400.0, 400.0, 700.0]).zip(off) {
            *position = [place + off, 0.0, 1000.0];
        }
        Ok(Progress {
            log_likelihood,
            rms_residual_mm,
            largest_move_mm: 2.0,
            rms_move_mm: 0.0,
            done: self.taken == self.steps.len() && self.name != "breaks",
        })
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}

const OPEN: f64 = f64::NAN;

/// Two stages with a likelihood and one without between them; the last one breaks down.
fn scripts() -> [Script; 3] {
    [
        Script::new(
            "lds",
            &[(Some(-1000.0), Some(9.0), [OPEN; 3]), (Some(-900.5), Some(8.0), [3.0, 4.0, 0.0]), (Some(-900.0), None, [0.0; 3])],
        ),
        Script::new("linear", &[(None, None, [1.0; 3])]),
        Script::new("breaks", &[(Some(-70.0), Some(1.0), [0.0, OPEN, 6.0])]),
    ]
}

fn about() -> About {
    About {
        source_name: "walk.c3d".into(),
        source_sha256: "ab".repeat(32),
        rate_hz: 59.94,
        first_frame: 101,
        frames: 4,
        markers: 3,
        bones: 3,
        up: Up::Stated(Direction::PLUS_Z),
        unit: "mm".into(),
        seed: 7,
        method: "lds".into(),
        options: vec![("max-iterations".into(), "5".into())],
        timings: false,
    }
}

fn closing() -> Closing<'static> {
    Closing {
        results: vec![("filled".into(), "3".into())],
        attachments: vec![Attachment { name: "report.json".into(), media_type: "application/json".into(), bytes: b"{}".to_vec() }],
        ..Closing::default()
    }
}

fn drive(log: &mut impl Observer, scripts: [Script; 3]) {
    let problem = problem();
    let limits = Limits { steps: 5, tolerance: 0.0, still_mm: 0.0, interrupt: None, meter: None };
    for (stage, mut script) in (0..).zip(scripts) {
        solve::run(&mut script, &problem, stage, &limits, log);
    }
}

fn write(path: &Path) -> Vec<u8> {
    let mut log = McapLog::create(path, about()).unwrap();
    drive(&mut log, scripts());
    let written = log.finish(&closing()).unwrap();
    let bytes = std::fs::read(path).unwrap();
    assert_eq!((written.messages, written.bytes), (14, bytes.len() as u64), "two per iteration, two per stage");
    bytes
}

fn metadata(bytes: &[u8]) -> BTreeMap<String, String> {
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    assert_eq!(summary.metadata_indexes.len(), 1);
    let record = mcap::read::metadata(bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!((record.name.as_str(), METADATA), ("mocap-repair", "mocap-repair"));
    record.metadata
}

/// Messages with their times in ns, in file order.
type Timed<M> = Vec<(u64, M)>;

/// All messages, decoded.
#[derive(Debug, Default)]
struct Told {
    likelihoods: Timed<schema::EmLikelihood>,
    residuals: Timed<schema::EmBoneResiduals>,
    lengths: Timed<schema::BoneLengths>,
    states: Timed<schema::MarkerStates>,
    raw: Timed<schema::foxglove::PointCloud>,
    repaired: Timed<schema::foxglove::PointCloud>,
    scenes: Timed<schema::foxglove::SceneUpdate>,
    events: Timed<schema::foxglove::Log>,
    axes: Timed<schema::foxglove::FrameTransforms>,
}

fn messages(bytes: &[u8]) -> Told {
    fn put<M: Message + Default>(list: &mut Timed<M>, message: &mcap::Message<'_>) {
        assert_eq!(message.sequence as usize, list.len(), "{}", message.channel.topic);
        list.push((message.log_time, M::decode(&message.data[..]).unwrap()));
    }
    let mut told = Told::default();
    let mut latest = 0;
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= latest && message.publish_time == message.log_time);
        latest = message.log_time;
        assert_eq!(message.channel.message_encoding, "protobuf");
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!(schema.encoding, "protobuf");
        match (message.channel.topic.as_str(), schema.name.as_str()) {
            ("/em/likelihood", "mocap_repair.EmLikelihood") => put(&mut told.likelihoods, &message),
            ("/em/bone_residuals", "mocap_repair.EmBoneResiduals") => put(&mut told.residuals, &message),
            ("/take/bone_lengths", "mocap_repair.BoneLengths") => put(&mut told.lengths, &message),
            ("/take/marker_state", "mocap_repair.MarkerStates") => put(&mut told.states, &message),
            ("/markers/raw", "foxglove.PointCloud") => put(&mut told.raw, &message),
            ("/markers/repaired", "foxglove.PointCloud") => put(&mut told.repaired, &message),
            ("/skeleton", "foxglove.SceneUpdate") => put(&mut told.scenes, &message),
            ("/log", "foxglove.Log") => put(&mut told.events, &message),
            ("/tf", "foxglove.FrameTransforms") => put(&mut told.axes, &message),
            other => panic!("{other:?}"),
        }
    }
    told
}

/// Every iteration as (stage, iteration, iteration of the log, ns).
const TICKS: [(u32, u32, u32, u64); 4] = [(0, 0, 0, 0), (0, 1, 1, 16_683_350), (0, 2, 2, 33_366_700), (2, 0, 3, 50_050_050)];

#[test]
fn likelihoods_are_those_of_the_solver() {
    let folder = tempfile::tempdir().unwrap();
    let likelihoods = messages(&write(&folder.path().join("walk.mcap"))).likelihoods;
    let ticks: Vec<_> = likelihoods.iter().map(|(t, m)| (m.stage, m.iteration, m.iteration_of_log, *t)).collect();
    assert_eq!(ticks, TICKS);
    for (log_time, m) in &likelihoods {
        let stamp = m.timestamp.unwrap();
        assert_eq!(stamp.seconds as u64 * 1_000_000_000 + stamp.nanos as u64, *log_time);
        assert_eq!((m.elapsed_s, m.largest_move_mm), (0.0, 2.0));
    }
    let values: Vec<_> = likelihoods.iter().map(|(_, m)| (m.log_likelihood, m.delta, m.converged, m.method.as_str())).collect();
    assert_eq!(
        values,
        [(-1000.0, 0.0, false, "lds"), (-900.5, 99.5, false, "lds"), (-900.0, 0.5, true, "lds"), (-70.0, 0.0, false, "breaks")]
    );
    let rms: Vec<f64> = likelihoods.iter().map(|(_, m)| m.rms_residual_mm).collect();
    assert!(rms[0] == 9.0 && rms[1] == 8.0 && rms[2].is_nan() && rms[3] == 1.0, "{rms:?}");
}

#[test]
fn bone_residuals_are_those_of_the_estimate() {
    let folder = tempfile::tempdir().unwrap();
    let residuals = messages(&write(&folder.path().join("walk.mcap"))).residuals;
    let ticks: Vec<_> = residuals.iter().map(|(t, m)| (m.stage, m.iteration, m.iteration_of_log, *t)).collect();
    assert_eq!(ticks, TICKS);
    for (_, m) in &residuals {
        let bones: Vec<_> = m.bones.iter().map(|b| (b.label.as_str(), b.length_mm, b.length_sd_mm)).collect();
        assert_eq!(bones, [("LFEM-LTIB", 400.0, 0.5), ("LTIB-LANK", 300.0, 0.25), ("LFEM-LTIB (2)", 400.0, 0.5)]);
    }
    let of =
        |k: usize, bone: usize| (residuals[k].1.bones[bone].value, residuals[k].1.bones[bone].max_mm, residuals[k].1.bones[bone].frames);
    let both = (12.5_f64.sqrt(), 4.0, 2); // 3 mm and 4 mm off
    assert_eq!([of(0, 0), of(0, 1), of(0, 2)], [(0.0, 0.0, 0); 3], "everything is open");
    assert_eq!([of(1, 0), of(1, 1), of(1, 2)], [both; 3]);
    assert_eq!([of(2, 0), of(2, 1), of(2, 2)], [(0.0, 0.0, 2); 3]);
    assert_eq!([of(3, 0), of(3, 1), of(3, 2)], [(0.0, 0.0, 1); 3], "frame 2 is open at one end");
}

#[test]
fn the_metadata_tell_how_it_was_made() {
    let folder = tempfile::tempdir().unwrap();
    let found = metadata(&write(&folder.path().join("walk.mcap")));
    let sha256 = "ab".repeat(32);
    for (key, value) in [
        ("version", env!("CARGO_PKG_VERSION")),
        ("source_name", "walk.c3d"),
        ("source_sha256", sha256.as_str()),
        ("rate_hz", "59.94"),
        ("first_frame", "101"),
        ("frames", "4"),
        ("markers", "3"),
        ("bones", "3"),
        ("t0_ns", "0"),
        ("seed", "7"),
        ("method", "lds"),
        ("timings", "false"),
        ("iterations", "4"),
        ("stages", "3"),
        ("stop_reason", "converged, converged, failed"),
        ("stage.0.method", "lds"),
        ("stage.0.stop_reason", "converged"),
        ("stage.0.steps", "3"),
        ("stage.0.step_limit", "5"),
        ("stage.1.method", "linear"),
        ("stage.2.stop_reason", "failed"),
        ("stage.2.error", "the script has ended"),
        ("option.max-iterations", "5"),
        ("result.filled", "3"),
    ] {
        assert_eq!(found.get(key).map(String::as_str), Some(value), "{key}");
    }
    for key in ["units", "iteration_time_base", "frame_time_base"] {
        assert!(found.contains_key(key), "{key}");
    }
}

#[test]
fn attachments_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = write(&folder.path().join("walk.mcap"));
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.attachment_indexes.len(), 1);
    let found = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!((found.name.as_str(), found.media_type.as_str(), &found.data[..]), ("report.json", "application/json", &b"{}"[..]));
    assert_eq!((found.log_time, found.create_time), (0, 0));
}

#[test]
fn a_schema_is_its_message_with_everything_it_imports() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = write(&folder.path().join("walk.mcap"));
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let schemas: BTreeMap<_, _> = summary.schemas.values().map(|s| (s.name.clone(), s)).collect();
    let names = [
        "foxglove.FrameTransforms",
        "foxglove.Log",
        "foxglove.PointCloud",
        "foxglove.SceneUpdate",
        "mocap_repair.BoneLengths",
        "mocap_repair.EmBoneResiduals",
        "mocap_repair.EmLikelihood",
        "mocap_repair.MarkerStates",
    ];
    assert_eq!(schemas.keys().collect::<Vec<_>>(), names);
    for (name, schema) in schemas {
        let set = prost_types::FileDescriptorSet::decode(&schema.data[..]).unwrap();
        let files: Vec<&str> = set.file.iter().map(prost_types::FileDescriptorProto::name).collect();
        let (package, message) = name.split_once('.').unwrap();
        assert_eq!(files.last(), Some(&format!("{package}/{message}.proto").as_str()), "{name}");
        let mut imported: Vec<&str> = set.file.iter().flat_map(|f| f.dependency.iter().map(String::as_str)).collect();
        imported.sort_unstable();
        imported.dedup();
        let mut others = files[..files.len() - 1].to_vec();
        others.sort_unstable();
        assert_eq!(others, imported, "{name}: what is imported, and nothing else");
        let own = set.file.last().unwrap();
        assert!(own.message_type.iter().any(|m| m.name() == message) && own.package() == package);
    }
}

#[test]
fn every_field_is_in_the_manual() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = write(&folder.path().join("walk.mcap"));
    let manual = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/mcap-log.md")).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut words: Vec<String> = summary.channels.values().map(|c| c.topic.clone()).collect();
    let schemas: BTreeMap<_, _> = summary.schemas.iter().collect();
    for schema in schemas.values() {
        let set = prost_types::FileDescriptorSet::decode(&schema.data[..]).unwrap();
        let messages: Vec<_> = set.file.iter().filter(|f| f.package() == "mocap_repair").flat_map(|f| &f.message_type).collect();
        words.push(schema.name.clone());
        words.extend(
            messages.iter().flat_map(|m| m.field.iter().chain(m.nested_type.iter().flat_map(|n| &n.field))).map(|f| f.name().to_owned()),
        );
    }
    // Options, results and stages have keys of their own making.
    words.extend(metadata(&bytes).into_keys().filter(|k| !k.contains('.')));
    assert!(words.len() > 30, "{words:?}");
    for word in words {
        assert!(manual.contains(&format!("`{word}`")), "docs/mcap-log.md does not explain {word}");
    }
}

#[test]
fn equal_runs_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(write(&folder.path().join("a.mcap")), write(&folder.path().join("b.mcap")));
}

#[test]
fn timings_are_written_when_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    let mut log = McapLog::create(&path, About { timings: true, ..about() }).unwrap();
    drive(&mut log, scripts());
    log.finish(&closing()).unwrap();
    let elapsed: Vec<f64> = messages(&std::fs::read(&path).unwrap()).likelihoods.iter().map(|(_, m)| m.elapsed_s).collect();
    assert!(elapsed[0] > 0.0 && elapsed.is_sorted(), "{elapsed:?}");
}

#[test]
fn a_method_without_a_likelihood_has_no_messages_but_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    let mut log = McapLog::create(&path, About { method: "linear".into(), ..about() }).unwrap();
    let mut linear = Script::new("linear", &[(None, None, [1.0; 3])]);
    solve::run(&mut linear, &problem(), 0, &Limits { steps: 1, tolerance: 0.0, still_mm: 0.0, interrupt: None, meter: None }, &mut log);
    log.finish(&Closing::default()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let Told { likelihoods, residuals, events, .. } = messages(&bytes);
    assert_eq!((likelihoods.len(), residuals.len(), events.len()), (0, 0, 2));
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!((summary.stats.unwrap().message_count, summary.channels.len()), (2, 9));
    let found = metadata(&bytes);
    assert_eq!((found["method"].as_str(), found["stage.0.method"].as_str(), found["iterations"].as_str()), ("linear", "linear", "0"));
}

#[test]
fn many_iterations_fill_many_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.mcap");
    let steps: Vec<_> = (0..8000).map(|k| (Some(f64::from(k)), Some(1.0), [0.0; 3])).collect();
    let mut log = McapLog::create(&path, about()).unwrap();
    let limits = Limits { steps: u32::MAX, tolerance: 0.0, still_mm: 0.0, interrupt: None, meter: None };
    solve::run(&mut Script::new("lds", &steps), &problem(), 0, &limits, &mut log);
    assert_eq!(log.finish(&Closing::default()).unwrap().messages, 16_002);
    let bytes = std::fs::read(&path).unwrap();
    assert!(mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes.len() > 1);
    let Told { likelihoods, residuals, .. } = messages(&bytes);
    assert_eq!((likelihoods.len(), residuals.len()), (8000, 8000));
    assert_eq!(likelihoods[5994].0, 100_000_000_000, "5994 iterations at 59.94 Hz");
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn an_unfinished_log_leaves_nothing_and_an_old_one_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    let mut log = McapLog::create(&path, about()).unwrap();
    drive(&mut log, scripts());
    let [hidden] = names(folder.path()).try_into().unwrap();
    assert!(hidden.starts_with(".walk.mcap.") && !path.exists(), "{hidden}");
    drop(log);
    assert!(names(folder.path()).is_empty());

    std::fs::write(&path, "old").unwrap();
    let log = McapLog::create(&path, about()).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    drop(log);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    write(&path);
    assert_eq!(names(folder.path()), ["walk.mcap"]);
}

#[test]
fn what_cannot_become_a_log_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |path: &Path, rate_hz: f64| McapLog::create(path, About { rate_hz, ..about() }).unwrap_err();
    for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused(&folder.path().join("walk.mcap"), rate_hz);
        assert!(matches!(error, LogError::Unsupported(_)) && error.to_string().contains("--rate"), "{error}");
    }
    assert!(refused(folder.path(), 100.0).to_string().contains("folder"));
    assert!(matches!(refused(&folder.path().join("no/such/walk.mcap"), 100.0), LogError::Io(_)));
    assert!(names(folder.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn others_may_read_a_log_as_any_other_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (log, plain) = (folder.path().join("walk.mcap"), folder.path().join("plain"));
    write(&log);
    std::fs::write(&plain, "").unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&log), mode(&plain));
}
