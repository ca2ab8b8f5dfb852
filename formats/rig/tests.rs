#![allow(clippy::unwrap_used, clippy::indexing_slicing)]
use super::*;
use crate::Notes;
use std::f64::consts::PI;

fn printed(notes: &Notes) -> Vec<String> {
    notes.take().iter().map(ToString::to_string).collect()
}

fn refused<T: std::fmt::Debug>(read: Result<T, crate::FormatError>) -> String {
    read.unwrap_err().to_string()
}

const SQUARE: &[[f64; 3]] = &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

#[test]
fn surfaces_are_read_as_programs_write_them() {
    let halves = vec![[0, 1, 2], [0, 2, 3]];
    for (text, normals, faces) in [
        ("OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n", false, halves.clone()),
        ("OFF 4 1 0\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n4 0 1 2 3\r\n", false, halves.clone()),
        (
            "\u{feff}off\n# made by hand\n\n4 2\n0 0 0 # first\n1 0 0\n1 1 0\n\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3 0.5 0.5 0.5 1",
            false,
            halves.clone(),
        ),
        ("4 0 0\n0 0 0\n1. 0 0\n1 1e0 0\n0 +1 -0\n", false, vec![]),
        ("OFF\n4\n0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n", false, vec![]),
        ("COFF\n4 0 0\n0 0 0 1 2 3 255\n1 0 0 .1 .2 .3 1\n1 1 0 0 0 0\n0 1 0\n", false, vec![]),
        ("NOFF\n4 0 0\n0 0 0 0 0 2\n1 0 0 0 0 1\n1 1 0 0 0 1e-3\n0 1 0 0 0 1e-200\n", true, vec![]),
        ("STCNOFF\n4 0 0\n0 0 0 0 0 2 1 2 3 4 .5 .5\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n", true, vec![]),
        ("CNSTOFF\r4 0 0\r0 0 0 0 0 2 1 2 3 4 .5 .5\r1 0 0 0 0 1\r1 1 0 0 0 1\r0 1 0 0 0 1\r", true, vec![]),
        ("OFF\n4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n1 3\n2 0 1\n3 1 2 3", false, vec![[1, 2, 3]]),
    ] {
        let mesh = read_mesh(text.as_bytes(), &Notes::new()).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!(mesh.vertices, SQUARE, "{text}");
        assert_eq!(mesh.normals, if normals { vec![[0.0, 0.0, 1.0]; 4] } else { vec![] }, "{text}");
        assert_eq!(mesh.faces, faces, "{text}");
        let mut out = Vec::new();
        write_mesh(&mesh, &mut out).unwrap();
        assert_eq!(read_mesh(&out, &Notes::new()).unwrap(), mesh, "{text}");
    }
    for empty in ["OFF 0 0 0", "NOFF\n0 0\n", "0 0 0"] {
        assert_eq!(read_mesh(empty.as_bytes(), &Notes::new()).unwrap(), Mesh::default());
    }
    assert_eq!(read_mesh(b"NOFF 1 0 0\n1 2 3 0 0 0", &Notes::new()).unwrap().normals, [[0.0; 3]]);
}

#[test]
fn faces_of_many_corners_become_fans() {
    let text = "OFF\n6 3 0\n0 0 0\n2 0 0\n3 1 0\n2 2 0\n0 2 0\n-1 1 0\n6 0 1 2 3 4 5\n5 5 4 3 2 1 0.5 0.5 0.5\n2 0 1\n";
    let mesh = read_mesh(text.as_bytes(), &Notes::new()).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [5, 4, 3], [5, 3, 2], [5, 2, 1]]);
}

#[test]
fn normals_that_are_not_announced_are_read_and_noted() {
    for (head, lines, normals) in [
        ("OFF", ["0 0 1", "0 -1 0", "0 0 0", "0.577 -0.577 0.577"], true),
        ("", ["0 0 1", "0 -1 0", "0 0 0", "1 0 0"], true),
        // colours: not negative, of another length, announced, not behind every vertex, of four numbers
        ("OFF", ["0 0 1", "0 1 0", "0 0 0", "1 0 0"], false),
        ("OFF", ["0 0 1", "0 -1 0", "0 0 0", "0.5 0.5 0.5"], false),
        ("COFF", ["0 0 1", "0 -1 0", "0 0 0", "1 0 0"], false),
        ("OFF", ["0 0 1", "0 -1 0", "", "1 0 0"], false),
        ("OFF", ["0 0 1", "0 -1 0", "0 0 0", "-1 0 0 1"], false),
    ] {
        let vertices: Vec<String> = lines.iter().map(|behind| format!("1 2 3 {behind}\n")).collect();
        let notes = Notes::new();
        let mesh = read_mesh(format!("{head}\n4 0 0\n{}", vertices.concat()).as_bytes(), &notes).unwrap();
        assert_eq!(mesh.vertices.len(), 4);
        assert_eq!(mesh.normals.len(), if normals { 4 } else { 0 }, "{lines:?}");
        assert_eq!(notes.take().len(), usize::from(normals), "{lines:?}");
        assert!(mesh.normals.iter().take(2).eq(&[[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]][..mesh.normals.len().min(2)]), "{mesh:?}");
    }
}

#[test]
fn wrong_surfaces_are_refused() {
    for (text, error) in [
        ("", "off: the file is empty; expected OFF and the numbers of vertices and faces (line 1)"),
        ("ply\n", "off: \"ply\" found, expected OFF or NOFF, or the numbers of vertices and faces (line 1)"),
        ("XOFF 1 0 0", "off: \"XOFF\" found, expected OFF or NOFF (line 1)"),
        ("4OFF\n1 0 0\n1 2 3 1", "off: 4OFF holds points of other than three coordinates; write it again as OFF or NOFF (line 1)"),
        ("nOFF 3\n1 0 0\n1 2 3", "off: nOFF holds points of other than three coordinates; write it again as OFF or NOFF (line 1)"),
        ("OFF BINARY\n\0\0\0\x01", "off: this is a binary OFF file; write it again as text (line 1)"),
        ("OFF\n1", "off: the file ends where the number of faces is expected; it was cut off (line 2)"),
        (
            "OFF\n99999999999999999999999 0 0",
            "off: \"99999999999999999999999\" found, which is more than there can be of anything; expected the number of vertices (line 2)",
        ),
        ("OFF\n-1 0 0", "off: \"-1\" found, expected the number of vertices (line 2)"),
        ("OFF\n1 0 0 7\n1 2 3", "off: expected nothing but the numbers of vertices, faces and edges in this line (line 2)"),
        ("OFF\n2 0 0\n1 2 3\n", "off: the file ends after 1 of 2 vertices; it was cut off, or its counts are wrong (line 4)"),
        ("OFF\n1 0 0\n1 2\n", "off: the line ends where a coordinate (three in each line of a vertex) is expected; complete it (line 3)"),
        ("OFF\n1 0 0\n1 nan 3\n", "off: \"nan\" found, expected a coordinate (three in each line of a vertex) (line 3)"),
        ("OFF\n1 0 0\n1 2 -inf\n", "off: \"-inf\" found, expected a coordinate (three in each line of a vertex) (line 3)"),
        ("OFF\n1 0 0\n1 2 1e13\n", "off: \"1e13\" is farther away than anything can be; correct it (line 3)"),
        (
            "NOFF\n1 0 0\n1 2 3\n",
            "off: the line ends where a coordinate of a normal (three behind those of the vertex) is expected; complete it (line 3)",
        ),
        (
            "OFF\n1 0 0\n1 2 3 4 5 6 7 8\n",
            "off: \"8\" found behind a vertex, expected the end of the line, or a colour of at most 4 numbers (line 3)",
        ),
        ("OFF\n1 1 0\n1 2 3\n", "off: the file ends after 0 of 1 faces; it was cut off, or its counts are wrong (line 4)"),
        (
            "OFF\n1 1 0\n1 2 3\n3 0 0 1\n",
            "off: a face has the vertex 1, but there are 1, counted from 0; correct it, or the number of vertices (line 4)",
        ),
        (
            "OFF\n1 1 0\n1 2 3\n3 0 0\n",
            "off: the line ends where a vertex of a face, counted from 0, as many as the first number of the line says is expected; complete it (line 4)",
        ),
        (
            "OFF\n1 1 0\n1 2 3\n4 5.5 6\n",
            "off: \"5.5\" found, expected a vertex of a face, counted from 0, as many as the first number of the line says (line 4)",
        ),
        (
            "OFF\n1 0 0\n1 2 3\n4 5 6\n",
            "off: there is more than the 1 vertices and 0 faces that the counts say; nothing was skipped, correct the counts (line 4)",
        ),
        ("OFF\n99999999999 0 0\n", "off: 99999999999 vertices; the most that are read are 4294967295"),
        (
            "OFF\n4294967295 4294967295 0\n",
            "off: the file ends after 0 of 4294967295 vertices; it was cut off, or its counts are wrong (line 3)",
        ),
    ] {
        assert_eq!(refused(read_mesh(text.as_bytes(), &Notes::new())), error);
    }
    let refuse = |mesh: &Mesh| refused(write_mesh(mesh, &mut Vec::new()));
    let one = Mesh { vertices: vec![[0.0; 3]], ..Mesh::default() };
    assert_eq!(
        refuse(&Mesh { normals: vec![[0.0; 3]; 2], ..one.clone() }),
        "off: 2 normals for 1 vertices; there has to be one for each, or none"
    );
    assert_eq!(refuse(&Mesh { faces: vec![[0, 0, 1]], ..one }), "off: the face [0, 0, 1] has a vertex that is not among 1");
    assert_eq!(refuse(&Mesh { vertices: vec![[f64::NAN; 3]], ..Mesh::default() }), "off: vertex 0 has a coordinate that is no number");
}

const ARM: &str = "KBSKEL 4
root translate NULL
body ball root
2nd revolute body
slide KBJOINT_TRANSLATE 2nd
root 0 90 0
body 0 90 0
2nd 20 130 0 0 0 -2
slide 25 130 0
";

fn arm() -> Skeleton {
    read_skeleton(ARM.as_bytes(), &Notes::new()).unwrap()
}

#[test]
fn skeletons_are_read() {
    let notes = Notes::new();
    let skeleton = read_skeleton(ARM.as_bytes(), &notes).unwrap();
    assert_eq!(printed(&notes), [""; 0]);
    let joint = |name: &str, kind, parent, centre| Joint { name: name.to_owned(), kind, parent, centre, state: [0.0; 3] };
    let expected = [
        joint("root", JointKind::Translate, None, [0.0, 90.0, 0.0]),
        joint("body", JointKind::Ball, Some(0), [0.0, 90.0, 0.0]),
        joint("2nd", JointKind::Revolute { axis: [0.0, 0.0, -1.0] }, Some(1), [20.0, 130.0, 0.0]),
        joint("slide", JointKind::Translate, Some(2), [25.0, 130.0, 0.0]),
    ];
    assert_eq!(skeleton.joints, expected);
    // the same words in other lines, and in another order
    let flat = ARM.replace('\n', " ");
    assert_eq!(read_skeleton(flat.as_bytes(), &notes).unwrap(), skeleton);
    let odd = "\u{feff}kbskel 3 # an arm\r\nslide TRANSLATE 2nd 2nd Revolute body root translate null body BALL root\r\n\
               2nd 20 130 0 0 0 -2 .5 slide 25 130 0\r\nbody 0 90 0 .1 .2 .3 root 0 90 0 1 2 3";
    let sorted = read_skeleton(odd.as_bytes(), &notes).unwrap();
    assert_eq!(
        printed(&notes),
        [
            "KBSKEL says 3 joints, there are 4; all that are there were read",
            "joints stand before their parents: slide; they were sorted, parents first"
        ]
    );
    assert_eq!(sorted.joints.iter().map(|j| j.state[0]).collect::<Vec<_>>(), [1.0, 0.1, 0.5, 0.0]);
    assert_eq!(sorted.joints.iter().map(|j| j.parent).collect::<Vec<_>>(), [None, Some(0), Some(1), Some(2)]);
    for skeleton in [skeleton, sorted] {
        let mut out = Vec::new();
        write_skeleton(&skeleton, &mut out).unwrap();
        assert_eq!(read_skeleton(&out, &Notes::new()).unwrap(), skeleton);
    }
}

/// Names that look like numbers are names where a name can stand.
#[test]
fn names_may_look_like_numbers() {
    let text = "KBSKEL 3 1 translate NULL 2 ball 1 3.5 revolute 2 1 2 1 3.5 2 1 2 3.5 3.5 1 2 3 1 0 0";
    let skeleton = read_skeleton(text.as_bytes(), &Notes::new()).unwrap();
    let centres: Vec<[f64; 3]> = skeleton.joints.iter().map(|j| j.centre).collect();
    assert_eq!(centres, [[2.0, 1.0, 3.5], [1.0, 2.0, 3.5], [1.0, 2.0, 3.0]]);
    let mut moved = skeleton.clone();
    moved.joints[0].state = [1.0, 3.5, 2.0];
    for skeleton in [skeleton, moved] {
        let mut out = Vec::new();
        write_skeleton(&skeleton, &mut out).unwrap();
        assert_eq!(read_skeleton(&out, &Notes::new()).unwrap(), skeleton);
    }
}

#[test]
fn wrong_skeletons_are_refused() {
    let arm = |from: &str, to: &str| ARM.replacen(from, to, 1);
    for (text, error) in [
        (String::new(), "skl: the file is empty; expected KBSKEL and the number of joints (line 1)"),
        (arm("KBSKEL", "KBCST"), "skl: \"KBCST\" found, expected KBSKEL at the beginning of the file (line 1)"),
        (arm("KBSKEL 4", "KBSKEL"), "skl: \"root\" found, expected the number of joints behind KBSKEL (line 2)"),
        ("KBSKEL 0".to_owned(), "skl: there are no joints; expected a name, a type and a parent for each (line 1)"),
        (arm("body ball", "body hinge"), "skl: \"hinge\" found behind the name \"body\", expected translate, revolute or ball (line 3)"),
        (
            arm("2nd revolute body", "2nd revolute chest"),
            "skl: the parent \"chest\" of \"2nd\" is no joint; correct it, or write NULL if there is none (line 4)",
        ),
        (
            arm("body ball root", "body ball NULL"),
            "skl: \"body\" is a second root, the first is in line 2; only one joint may have the parent NULL (line 3)",
        ),
        (arm("body ball root", "root ball root"), "skl: there are two joints of the name \"root\"; rename one of them (line 3)"),
        (
            arm("root translate NULL", "root translate slide"),
            "skl: these joints hang on each other in a circle: root, slide, 2nd, body; correct the parent of one of them (line 2)",
        ),
        (
            arm("slide KBJOINT_TRANSLATE 2nd", "slide translate slide"),
            "skl: \"slide\" hangs on itself; name its parent, or NULL if there is none (line 5)",
        ),
        (
            arm("body 0 90 0\n", ""),
            "skl: \"body\" has no coordinates; add its name and its three numbers: where it is behind the joints (line 3)",
        ),
        (
            arm("root 0 90 0", "rot 0 90 0"),
            "skl: \"rot\" is no joint of the skeleton, which has 2nd, body, root, slide; correct the name (line 6)",
        ),
        (arm("root 0 90 0", "body 0 90 0"), "skl: \"body\" has its coordinates twice; take one of them away (line 7)"),
        (
            arm("2nd 20 130 0 0 0 -2", "2nd 0.5"),
            "skl: \"2nd\" has 1 number behind it, a revolute joint has six numbers: where it is, and the axis about which it turns, and perhaps \
             1 number of the pose to begin with; one alone can be its angle, but does not tell where it is and about which axis it turns (line 8)",
        ),
        (
            arm("slide 25 130 0", "slide 25 130 0 1 2"),
            "skl: \"slide\" has 5 numbers behind it, a translate joint has three numbers: where it is, and perhaps 3 numbers of the pose to begin \
             with (line 9)",
        ),
        (
            arm("0 0 -2", "0 0 1e-10"),
            "skl: the axis of \"2nd\" has no length, so it has no direction; give the direction about which the joint turns (line 8)",
        ),
        (
            arm("slide 25 130 0", "slide 25 130,5 0"),
            "skl: \"130,5\" found among the numbers of \"slide\", expected three numbers: where it is (line 9)",
        ),
        (
            arm("slide 25 130 0", "slide 25 130 nan"),
            "skl: \"nan\" found among the numbers of \"slide\", expected three numbers: where it is (line 9)",
        ),
        (
            arm("slide 25 130 0", "slide 25 130 0 more"),
            "skl: \"more\" is no joint of the skeleton, which has 2nd, body, root, slide; correct the name (line 9)",
        ),
    ] {
        assert_eq!(refused(read_skeleton(text.as_bytes(), &Notes::new())), error);
    }
}

#[test]
fn names_that_no_file_can_hold_are_changed() {
    let mut skeleton = arm();
    skeleton.joints[0].name = "NULL".to_owned();
    skeleton.joints[1].name = "the body".to_owned();
    skeleton.joints[2].name = "the_body".to_owned();
    skeleton.joints[3].name = String::new();
    let mut out = Vec::new();
    write_skeleton(&skeleton, &mut out).unwrap();
    let names: Vec<String> = read_skeleton(&out, &Notes::new()).unwrap().joints.into_iter().map(|j| j.name).collect();
    assert_eq!(names, ["NULL_2", "the_body_2", "the_body", "joint_4"]);
    let mut out = Vec::new();
    write_parts(&[1, 2, 0], &skeleton, &mut out).unwrap();
    assert_eq!(out, b"the_body_2\nthe_body\nNULL_2\n");
}

const LIMITS: &str = "KBCST 3\nslide 1 2 0\n2nd -31.9 90\nbody 0 0 2 60 1 0 0 90\n";

#[test]
fn limits_are_read() {
    let read = |text: &str, unit| {
        let notes = Notes::new();
        (read_limits(text.as_bytes(), &arm(), unit, &notes).unwrap(), printed(&notes))
    };
    let (limits, notes) = read(LIMITS, None);
    assert_eq!(notes, ["the limits do not name the unit of their angles; degrees assumed, because 60 radians are more than a whole turn"]);
    let expected = [
        None,
        Some(Limit::Ball {
            heading: [0.0, 0.0, 1.0],
            heading_most: 60.0_f64.to_radians(),
            bank: [1.0, 0.0, 0.0],
            bank_most: 90.0_f64.to_radians(),
        }),
        Some(Limit::Revolute { least: -31.9_f64.to_radians(), most: 90.0_f64.to_radians() }),
        Some(Limit::Translate { farthest: [1.0, 2.0, 0.0] }),
    ];
    assert_eq!(limits, expected);
    assert_eq!(read(LIMITS, Some(AngleUnit::Degree)), (expected.to_vec(), vec![]));
    let (stated, notes) = read(LIMITS, Some(AngleUnit::Radian));
    assert_eq!((stated[2], notes), (Some(Limit::Revolute { least: -31.9, most: 90.0 }), vec![]));
    // directions and distances are no angles
    let (radians, notes) = read("KBCST 7 slide 100 100 100 2nd -6.2 6.2 body 0 0 20 3.1 10 0 0 3.1", None);
    assert_eq!(radians[2], Some(Limit::Revolute { least: -6.2, most: 6.2 }));
    assert_eq!(notes, ["KBCST says 7 joints with limits, there are 3; all that are there were read"]);
    for limits in [radians, limits, stated] {
        let mut out = Vec::new();
        write_limits(&limits, &arm(), &mut out).unwrap();
        let again = read_limits(&out, &arm(), None, &Notes::new()).unwrap();
        for (was, is) in limits.iter().zip(&again) {
            let near = match (was, is) {
                (Some(Limit::Revolute { least: a, most: b }), Some(Limit::Revolute { least: c, most: d })) => {
                    (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12
                }
                (Some(Limit::Ball { heading_most: a, .. }), Some(Limit::Ball { heading_most: c, .. })) => (a - c).abs() < 1e-12,
                _ => was == is,
            };
            assert!(near, "{was:?} {is:?}");
        }
    }
}

#[test]
fn wrong_limits_are_refused() {
    let read = |from: &str, to: &str| refused(read_limits(LIMITS.replacen(from, to, 1).as_bytes(), &arm(), None, &Notes::new()));
    for (from, to, error) in [
        ("KBCST", "KBSKEL", "cst: \"KBSKEL\" found, expected KBCST at the beginning of the file (line 1)"),
        ("KBCST 3", "KBCST x", "cst: \"x\" found, expected the number of joints with limits behind KBCST (line 1)"),
        ("slide", "hand", "cst: \"hand\" is no joint of the skeleton, which has 2nd, body, root, slide; correct the name (line 2)"),
        ("slide 1 2 0", "2nd 0 1", "cst: \"2nd\" has its limits twice; take one of them away (line 3)"),
        ("-31.9 90", "90 -31.9", "cst: the least angle of \"2nd\", 90, is above the largest, -31.9; exchange them (line 3)"),
        ("-31.9 90", "90", "cst: \"2nd\" has 1 number behind it, expected two numbers: its least and its largest angle (line 3)"),
        ("-31.9 90", "0 1 2", "cst: \"2nd\" has 3 numbers behind it, expected two numbers: its least and its largest angle (line 3)"),
        (
            "-31.9 90",
            "a 90",
            "cst: \"a\" found among the numbers of \"2nd\", expected two numbers: its least and its largest angle (line 3)",
        ),
        ("1 2 0", "1 -2 0", "cst: the farthest shift of \"slide\" is -2, below 0; correct it (line 2)"),
        ("0 0 2 60", "0 0 0 60", "cst: the heading direction of \"body\" has no length; give a direction in the reference pose (line 4)"),
        ("1 0 0 90", "0 0 0 90", "cst: the bank direction of \"body\" has no length; give a direction in the reference pose (line 4)"),
        ("0 0 2 60", "0 0 2 -60", "cst: the largest angle of the heading of \"body\" is -60, below 0; correct it (line 4)"),
        (
            "1 0 0 90",
            "",
            "cst: \"body\" has 4 numbers behind it, expected eight numbers: the direction of the limb and its largest angle, a direction across \
             the limb and its largest angle (line 4)",
        ),
    ] {
        assert_eq!(read(from, to), error);
    }
    let of_ball = [Some(Limit::Revolute { least: 0.0, most: PI }), None, None, None];
    let error = refused(write_limits(&of_ball, &arm(), &mut Vec::new()));
    assert_eq!(error, "cst: the limit of joint \"root\" belongs to a joint of another type");
}

#[test]
fn parts_are_a_name_for_every_vertex() {
    let read = |text: &str, vertices| read_parts(text.as_bytes(), &arm(), vertices).map_err(|e| e.to_string());
    let three = Ok(vec![1, 1, 2]);
    for text in ["body\nbody\n2nd\n", "\u{feff}body\r\n body\t\r\n2nd", "body\rbody\r2nd\r\n\r\n\n  \n"] {
        assert_eq!(read(text, 3), three, "{text:?}");
    }
    assert_eq!(read("", 0), Ok(vec![]));
    for (text, vertices, error) in [
        ("body\n\n2nd\n", 3, "vj: the line is empty, so vertex 1 has no joint; name the joint that moves it, nothing was skipped (line 2)"),
        (
            "body\nbody\n\n",
            3,
            "vj: the file ends after 2 lines, but the surface has 3 vertices; vertex 2 and those behind it have no joint that moves them (line 2)",
        ),
        (
            "",
            1,
            "vj: the file ends after 0 lines, but the surface has 1 vertices; vertex 0 and those behind it have no joint that moves them (line 1)",
        ),
        ("body\nhead\n", 2, "vj: \"head\" is no joint of the skeleton, which has 2nd, body, root, slide; correct the name (line 2)"),
        (
            "body\nbody\nbody\n",
            2,
            "vj: more lines than the 2 vertices of the surface; one line belongs to each vertex, in their order (line 3)",
        ),
    ] {
        assert_eq!(read(text, vertices), Err(error.to_owned()));
    }
    let mut out = Vec::new();
    write_parts(&[1, 1, 2], &arm(), &mut out).unwrap();
    assert_eq!(out, b"body\nbody\n2nd\n");
    assert_eq!(refused(write_parts(&[4], &arm(), &mut out)), "vj: a vertex belongs to joint 4, but there are 4, counted from 0");
}

const HIERARCHY: &str = "HIERARCHY
ROOT hips
{ OFFSET 1 2 3 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
JOINT spine
{ OFFSET 0 10 0 JOINT neck tie
{ OFFSET 0 20 0 CHANNELS 2 Zrotation Xrotation
End Site
{ OFFSET 0 5 0 } } }
JOINT knee
{ OFFSET 5 -40 0 CHANNELS 1 Yrotation
JOINT foot
{ OFFSET 0 -40 0 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
JOINT toe
{ OFFSET 0 0 10 CHANNELS 3 Xposition Yposition Zposition End Site
{ OFFSET 0 0 1 } } } } }
MOTION
";

#[test]
fn a_hierarchy_becomes_a_skeleton() {
    let notes = Notes::new();
    let skeleton = skeleton_of_bvh(HIERARCHY.as_bytes(), &notes).unwrap();
    let joint = |name: &str, kind, parent, centre| Joint { name: name.to_owned(), kind, parent, centre, state: [0.0; 3] };
    let expected = [
        joint("hips_translation", JointKind::Translate, None, [1.0, 2.0, 3.0]),
        joint("hips", JointKind::Ball, Some(0), [1.0, 2.0, 3.0]),
        joint("neck_tie", JointKind::Ball, Some(1), [1.0, 32.0, 3.0]),
        joint("knee", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }, Some(1), [6.0, -38.0, 3.0]),
        joint("foot", JointKind::Ball, Some(3), [6.0, -78.0, 3.0]),
        joint("toe", JointKind::Translate, Some(4), [6.0, -78.0, 13.0]),
    ];
    assert_eq!(skeleton.joints, expected);
    assert_eq!(
        printed(&notes),
        [
            "joints without channels are not in the skeleton, what hangs on them hangs on their parents: spine",
            "joints with two rotation channels turn freely in the skeleton: neck tie",
            "position channels of joints that also turn are not in the skeleton, whose joints stay at their OFFSETs: foot",
            "1 names of joints that have blanks, control characters or # in them were changed: now called neck_tie",
        ]
    );
    let two = HIERARCHY.replace("MOTION", "ROOT b\n{ OFFSET 0 0 0 CHANNELS 1 Xrotation }\nMOTION");
    let error = "bvh: \"b\" is a second ROOT; a skeleton has one, so take the other out of the file";
    assert_eq!(refused(skeleton_of_bvh(two.as_bytes(), &notes)), error);
    let far = HIERARCHY.replace("OFFSET 0 20 0", "OFFSET 0 1e12 0");
    let error = "bvh: joint \"neck tie\" is farther away than anything can be; correct its OFFSET";
    assert_eq!(refused(skeleton_of_bvh(far.as_bytes(), &notes)), error);
    assert!(refused(skeleton_of_bvh(b"OFF", &notes)).contains("HIERARCHY"));
}

/// Every beginning of each file, and each file with a byte changed: an error or a value, and nothing else.
#[test]
fn no_damage_brings_a_reader_down() {
    let square = "NOFF\n4 2 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n4 0 1 2 3 0.5\n3 0 1 2\n";
    let read = |bytes: &[u8]| {
        let notes = Notes::new();
        if let Ok(mesh) = read_mesh(bytes, &Notes::new()) {
            assert!(mesh.faces.iter().flatten().all(|&v| (v as usize) < mesh.vertices.len()));
        }
        let _ = read_skeleton(bytes, &notes).map(|skeleton| write_skeleton(&skeleton, &mut Vec::new()).unwrap());
        let _ = read_limits(bytes, &arm(), None, &notes);
        let _ = read_parts(bytes, &arm(), 3);
        let _ = skeleton_of_bvh(bytes, &notes).map(|skeleton| write_skeleton(&skeleton, &mut Vec::new()).unwrap());
    };
    for text in [square, ARM, LIMITS, HIERARCHY, "body\nbody\n2nd\n"] {
        for cut in 0..text.len() {
            read(&text.as_bytes()[..cut]);
            for byte in [0, b'\n', b' ', b'9', b'-', b'#', b'N', 0xff] {
                let mut bytes = text.as_bytes().to_vec();
                bytes[cut] = byte;
                read(&bytes);
            }
        }
    }
}
