//! Tests of packings.

use std::ffi::OsStr;
use std::io::Write;
use std::os::unix::ffi::OsStrExt;

use gshear_dem::boundary::{PERIODIC, ROUGH_WALLS};
use gshear_dem::dimension::Two;
use gshear_dem::failure::Failure;
use gshear_dem::state::{Cell, Sheared};

use super::cell::LAST_ID;
use super::*;
use crate::Source;
use crate::testing::{cases, overrides};

const FILE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../tests/scenes/triangular.data"
);
const TEXT: &str = include_str!("../../../../tests/scenes/triangular.data");

/// The packing as changed by `edit`, and a scene of it.
fn packing(edit: impl Fn(String) -> String, sets: &str) -> Result<(Packing, Scene)> {
    let data = lammps_data::parse("f", &edit(TEXT.into()))?;
    packing_of(data, 1, sets)
}

/// Copies along x.
fn along(copies: u32) -> Arrangement {
    Arrangement {
        copies: [copies, 1, 1],
        ..Arrangement::BETWEEN_WALLS
    }
}

fn packing_of(data: DataFile, copies: u32, sets: &str) -> Result<(Packing, Scene)> {
    let text = "
        material.density = 2500
        contact = { law = 'hooke', normal_stiffness = 1e6, friction = 0.5, damping_ratio = 0.1 }
        sample.packing = 'f'
        load.stiffness_number = 1e3
        shear = { inertial_number = 1e-3, strain = 0.01 }
    ";
    let arrangement = along(copies);
    let data = replicated("f", data, arrangement.copies, &GrainLimit::default())?;
    let packing = Packing::new("f", Path::new(FILE), data, arrangement)?;
    let source = Source::new("s", text);
    let scene = crate::load_with(&source, &overrides(sets), &mut |_, _| {
        Ok(packing.file.clone())
    })?;
    Ok((packing, scene))
}

fn grains(edit: impl Fn(String) -> String, sets: &str) -> Result<Vec<GrainState>> {
    let (packing, scene) = packing(edit, sets)?;
    packing.grains(&scene)
}

fn message<T>(result: Result<T>) -> String {
    match result {
        Err(Failure::Input(message)) => message.replace(FILE, "f"),
        Err(other) => panic!("not bad input: {other}"),
        Ok(_) => panic!("taken"),
    }
}

fn refused(edit: impl Fn(String) -> String, sets: &str) -> String {
    message(grains(edit, sets))
}

/// Replaces the row of an atom, which begins with its id.
fn with_atom(row: &str) -> impl Fn(String) -> String + '_ {
    move |text| {
        let (id, _) = row.split_once(' ').unwrap();
        let (head, tail) = text.split_once("Velocities").unwrap();
        let at = head.find(&format!("\n{id} ")).unwrap() + 1;
        let end = at + head[at..].find('\n').unwrap();
        format!("{}{row}{}Velocities{tail}", &head[..at], &head[end..])
    }
}

/// Before memory is taken for them.
#[test]
fn too_many_copies_are_refused() {
    let read = |n| {
        let arrangement = Arrangement {
            copies: [n, n, 1],
            ..Arrangement::BETWEEN_WALLS
        };
        message(Packing::read(Path::new(FILE), arrangement))
    };
    let expected = "f: has 120 atoms in 1000000 × 1000000 × 1 copies (sample.replicate): 120000000000000 grains are more than the 4294967295 that a run can have; give fewer";
    assert_eq!(read(1_000_000), expected);
    let limit = GrainLimit {
        most: 119,
        reason: "fit".into(),
    };
    let expected = "f: has 120 atoms: 120 grains are more than the 119 that fit; give fewer";
    let read = Packing::read_at_most(Path::new(FILE), along(1), &limit);
    assert_eq!(message(read), expected);
    let long = TEXT.replace("-0.002 0.00799 xlo", "-0.002 1e307 xlo");
    assert_ne!(long, TEXT);
    let data = lammps_data::parse("f", &long).unwrap();
    let copies = replicated("f", data, [100, 1, 1], &GrainLimit::default());
    let expected = "f: 100 copies of the box along x (sample.replicate) are longer than a number can say; give fewer";
    assert_eq!(message(copies), expected);
}

#[test]
fn files_that_cannot_be_read_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let read = |path: &Path| {
        let name = format!("{}/", folder.path().display());
        message(Packing::read(path, along(1))).replace(&name, "")
    };
    let path = folder.path().join("file");
    let said = read(folder.path());
    assert!(said.ends_with(&format!(": is a directory; give {FORMAT}")));
    assert_eq!(read(&path), format!("file: no such file; give {FORMAT}"));
    // Without an end.
    let device = read(Path::new("/dev/zero"));
    assert_eq!(device, format!("/dev/zero: is a device; give {FORMAT}"));
    // As gzip writes them, cut short, or of zeros alone.
    let packed = |text: &[u8]| {
        let mut to = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        to.write_all(text).unwrap();
        to.finish().unwrap()
    };
    let good = packed(&TEXT.replace('\n', " # Gr\u{f6}\u{df}e\n").into_bytes());
    std::fs::write(&path, &good).unwrap();
    assert_eq!(Packing::read(&path, along(1)).unwrap().file.grains, 120);
    let mut latin1 = TEXT.as_bytes().to_vec();
    latin1.extend(b"# Gr\xf6\xdfe\n");
    std::fs::write(&path, latin1).unwrap();
    assert_eq!(Packing::read(&path, along(1)).unwrap().file.grains, 120);
    std::fs::write(&path, &good[..good.len() / 2]).unwrap();
    let said = read(&path);
    assert!(said.starts_with("file: cannot be unpacked: "), "{said}");
    std::fs::write(&path, packed(&vec![0; 10_000_000])).unwrap();
    let expected = "file: has more than 100 times its bytes when unpacked; unpack it with gunzip";
    assert_eq!(read(&path), expected);
    std::fs::write(&path, "x".repeat(10_000_000)).unwrap();
    assert_eq!(read(&path), "file: the header lacks the line `N atoms`");
    std::fs::write(&path, format!("\n{}", "7".repeat(10_000_000))).unwrap();
    assert!(read(&path).len() < 300, "{}", read(&path).len());
    // The scene names the path.
    let odd = folder.path().join(OsStr::from_bytes(b"\xff"));
    std::fs::write(&odd, TEXT).unwrap();
    let said = read(&odd);
    assert!(said.ends_with("is not UTF-8; rename it"), "{said}");
}

/// The same grains in other formats.
#[test]
fn dumps_and_lists_are_read() {
    let data = lammps_data::parse("f", TEXT).unwrap();
    let [[xlo, xhi], [ylo, yhi], [zlo, zhi]] = data.bounds;
    let row = |a: &Atom| {
        let ([x, y, z], [u, v, w]) = (a.position, a.velocity);
        let (id, kind, radius, spin) = (a.id, a.kind, 0.5 * a.diameter, a.angular_velocity[2]);
        format!("{radius:?} {id} {kind} {x:?} {y:?} {z:?} {u:?} {v:?} {w:?} 0 0 {spin:?}\n")
    };
    let rows: String = data.atoms.iter().map(row).collect();
    let head = |step: u32, count: usize| {
        format!(
            "ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{count}\nITEM: BOX BOUNDS pp ff ff\n{xlo:?} {xhi:?}\n{ylo:?} {yhi:?}\n{zlo:?} {zhi:?}\nITEM: ATOMS radius id type x y z vx vy vz omegax omegay omegaz\n"
        )
    };
    let first = format!("{}1.0 1 1 0 0 0 0 0 0 0 0 0\n", head(0, 1));
    let dump = format!("ITEM: UNITS\nsi\n{first}{}{rows}", head(100, 120));
    let without_lines = |mut data: DataFile| {
        data.atoms
            .iter_mut()
            .for_each(|a| (a.line, a.density) = (0, 1.0));
        data
    };
    let mut expected = without_lines(data.clone());
    expected.bounded = [None, Some("ff".into()), Some("ff".into())];
    for frame in [None, Some(1)] {
        let read = parsed("f", dump.as_bytes(), frame).unwrap();
        assert_eq!(read.atoms[0].line, 22);
        assert_eq!(without_lines(read), expected);
    }
    // A run that was killed leaves a part of its last frame, at least of the heading.
    let whole = dump.len() - rows.len();
    for cut in [whole - 20, whole, dump.len() - 30] {
        for (name, frame) in [("f", None), ("f@1", Some(1))] {
            let said = message(parsed(name, &dump.as_bytes()[..cut], frame));
            let hint = "; the last frame may be cut off: f@0 is the one before it";
            assert!(said.ends_with(hint), "{said}");
        }
    }
    let only = &dump.as_bytes()[first.len() + 15..dump.len() - 30];
    assert!(!message(parsed("f", only, None)).contains("f@"));
    let one = parsed("f", dump.as_bytes(), Some(0)).unwrap();
    assert_eq!(one.atoms.len(), 1);
    let said = message(parsed("f", dump.as_bytes(), Some(2)));
    let expected = "f: has 2 frames; give @0 … of one that it has, or none for the last";
    assert_eq!(said, expected);

    // Parts of the edges of a tilted box, as LAMMPS computes them.
    let tilted = "ITEM: TIMESTEP\n7\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS xy xz yz pp pp pp\n-1.25 4.5 -0.25\n0 2.5 0.5\n0 1 0.5\nITEM: ATOMS id xs ys zs diameter\n3 0.5 0.25 0.5 0.1\n";
    let read = parsed("f", tilted.as_bytes(), None).unwrap();
    assert_eq!(read.bounds, [[-1.0, 4.0], [0.0, 2.0], [0.0, 1.0]]);
    assert_eq!(read.tilt, [-0.25, 0.5, 0.5]);
    assert_eq!(read.atoms[0].position, [1.6875, 0.75, 0.5]);
    assert_eq!((read.atoms[0].id, read.atoms[0].diameter), (3, 0.1));
    for [from, to, expected] in cases(
        r#"
        diameter | mass | f:9: there is no column radius; write it by dump custom with id type x y z radius, and for moving grains vx vy vz omegax omegay omegaz
        id xs | id x | f:9: there is no column x, y or z; write it by dump custom with id type x y z radius, and for moving grains vx vy vz omegax omegay omegaz
        3 0.5 | 3 half | f:10: "half" is no number; a row has a number for every column
        3 0.5 | 3 | f:10: 4 columns; a row has a number for every column
        ATOMS\n1 | ATOMS\nall | f:4: "all" is no number of atoms
        -1.25 4.5 -0.25 | -1.25 4.5 -0.25 1 | f:6: a general triclinic box is not taken; dump one whose first edge is along x
        -0.25\n | 9\n | f:5: the box is tilted by more than its bounds are apart
        BOX BOUNDS | CELL | f:5: ITEM: CELL xy xz yz pp pp pp is not expected here; a frame has ITEM: TIMESTEP, NUMBER OF ATOMS, BOX BOUNDS, ATOMS
        "#,
    ) {
        let text = tilted.replacen(&from, &to, 1);
        assert_ne!(text, tilted, "{from}");
        assert_eq!(message(parsed("f", text.as_bytes(), None)), expected);
    }

    let list = "##PERIODIC:: 4 3 2\n# x y z r\n1 2 0.5 0.25\n3 2 1 0.125 7\n";
    let read = parsed("f", list.as_bytes(), None).unwrap();
    assert_eq!(read.bounds, [[0.0, 4.0], [0.0, 3.0], [0.0, 2.0]]);
    let rows = read.atoms.iter().map(|a| (a.id, a.position, a.diameter));
    let expected = [(1, [1.0, 2.0, 0.5], 0.5), (2, [3.0, 2.0, 1.0], 0.25)];
    assert!(rows.eq(expected), "{:?}", read.atoms);
    let refused = |bytes: &[u8], frame| message(parsed("f", bytes, frame));
    for [text, expected] in cases(
        r#"
        1 2 3 4\n | f: a list of spheres x y z r lacks its box; begin it with the line ##PERIODIC:: L_x L_y L_z
        ##PERIODIC:: 1 1 0\n1 2 3 4\n | f:1: a length of the box is 0.0; write: ##PERIODIC:: L_x L_y L_z
        ##PERIODIC:: 1 1 1\n1 2 3 4\n1 2 3\n | f:3: 3 columns are too few; a row is x y z r
        ##PERIODIC:: 1 1 1\n0 Sphere .1 .1 .1 .1\n | f:2: 0 Sphere .1 .1 .1 .1 is no row of a list of spheres, which is x y z r: four numbers with blanks between them, and YADE's clumpId after them
        ##PERIODIC:: 1 1 1\n0.1,0.1,0.1,0.1\n | f:2: 0.1,0.1,0.1,0.1 is no row of a list of spheres, which is x y z r: four numbers with blanks between them, and YADE's clumpId after them
        ##PERIODIC:: 1 1 1\n1 2 3 4 0\n1 2 3 4 -1\n1 2 3 4 0\n | f:4: spheres 1 (line 2) and 3 form clump 0 (the fifth column, YADE's clumpId), but samples have no clumps; give a packing of single spheres, with -1 in this column or without it
        ##PERIODIC:: 1 1 1\n1 2 3 4 .5\n | f:2: ".5" is no number of a clump (the fifth column, YADE's clumpId); -1 is none
        "#,
    ) {
        assert_eq!(refused(text.as_bytes(), None), expected);
    }
    let clumps = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\nITEM: ATOMS id id_multisphere x y z radius\n7 -1 0 0 0 1\n8 2 0 0 0 1\n9 2 0 0 0 1\n";
    let expected = "f:12: spheres 8 (line 11) and 9 form clump 2 (id_multisphere), but samples have no clumps; give a packing of single spheres, with -1 in this column or without it";
    assert_eq!(refused(clumps.as_bytes(), None), expected);
    let single = clumps.replace("9 2", "9 3");
    assert_eq!(parsed("f", single.as_bytes(), None).unwrap().atoms.len(), 3);
    let marked = "\u{feff}1 2 3 4\n".as_bytes();
    let expected = "f: a list of spheres x y z r lacks its box; begin it with the line ##PERIODIC:: L_x L_y L_z";
    assert_eq!(refused(marked, None), expected);
    let expected = "f: holds one state; leave out @3";
    assert_eq!(refused(TEXT.as_bytes(), Some(3)), expected);
    let utf_16 = b"\xff\xfe1\0";
    let expected = "f: is text in UTF-16; save it as UTF-8";
    assert_eq!(refused(utf_16, None), expected);
}

/// Of mean overlaps of 1 µm, in boxes moved along either axis.
#[test]
fn coordinates_that_do_not_resolve_overlaps_are_refused() {
    let moved = |by: f64, axis: usize| {
        move |text: String| {
            let lines = text.lines().map(|line| {
                let mut words: Vec<String> = line.split(' ').map(String::from).collect();
                let at = match &words[..] {
                    [_, _, low, _] if *low == ["xlo", "ylo"][axis] => 0..2,
                    [_, _, _, density, ..] if density == "2500" => 4 + axis..5 + axis,
                    _ => 0..0,
                };
                for word in &mut words[at] {
                    *word = format!("{:?}", word.parse::<f64>().unwrap() + by);
                }
                words.join(" ")
            });
            lines.collect::<Vec<_>>().join("\n")
        }
    };
    for axis in [0, 1] {
        let said = refused(moved(1e4, axis), "");
        let expected = "s:4: sample.packing: coordinates up to 1.0e4 are rounded by 1.1e-12, more than 1e-6 of the mean overlap of 1.0e-6; give coordinates up to 9.0e3, or a load that presses grains together by 1.1e-6 or more (a stiffness number of at most 9.0e2)";
        assert_eq!(said, expected);
        refused(moved(1e9, axis), "");
        assert!(grains(moved(0.5, axis), "").is_ok());
    }
}

#[test]
fn what_the_scene_knows_of_it() {
    let file = Packing::read(Path::new(FILE), along(1)).unwrap().file;
    assert_eq!((file.grains, file.wall_types), (120, true));
    let size = (file.radius_min, file.radius_max, file.mean_volume);
    assert_eq!((size.0, size.1), (0.5e-3, 0.5e-3));
    assert!((size.2 / (std::f64::consts::PI * 0.25e-6) - 1.0).abs() < 1e-14);
    assert!((file.mean_diameter / 1e-3 - 1.0).abs() < 1e-14);
    assert_eq!(file.length, 0.00799 - -0.002);
    assert_eq!(file.edges[0], 0.0);
    let rows = 1e-3 + 11.0 * 0.5 * 3f64.sqrt() * 0.999e-3;
    assert!((file.edges[1] / rows - 1.0).abs() < 1e-14);
}

/// A grain is followed by its id; copies are numbered on, and stand beside each other.
#[test]
fn ids_are_those_of_the_file() {
    let once = lammps_data::parse("f", TEXT).unwrap();
    let [low, high] = once.bounds[0];
    let edges = packing_of(once.clone(), 1, "").unwrap().0.file.edges;
    let period = packing_of(once.clone(), 1, "").unwrap().0.file.length;
    for copies in [1, 2, 3] {
        let (packing, scene) = packing_of(once.clone(), copies, "").unwrap();
        let file = &packing.file;
        assert_eq!((file.grains, file.edges), (120 * copies, edges));
        let length = f64::from(copies) * period;
        // The far end of the box is rounded.
        assert!((file.length / length - 1.0).abs() <= 2.0 * f64::EPSILON);
        let all = packing.grains(&scene).unwrap();
        assert_eq!(all.len(), 120 * copies as usize);
        for (k, grain) in all.iter().enumerate() {
            assert_eq!(grain.id as usize, k);
            let atom = once.atoms.iter().find(|a| a.id as usize == k % 120 + 1);
            let atom = atom.expect("ids from 1 on");
            let x = atom.position[0] - low + (k / 120) as f64 * (high - low);
            let apart = (grain.position[0] - x).abs() % (f64::from(copies) * (high - low));
            assert!(apart < 1e-15, "{k}: {apart}");
            assert_eq!(grain.position[1], atom.position[1]);
            assert_eq!(grain.radius, 0.5 * atom.diameter);
        }
    }
}

#[test]
fn ids_may_have_gaps() {
    let mut data = lammps_data::parse("f", TEXT).unwrap();
    let renumbered = |id: u64| 3 * id + 5 * u64::from(id > 40) + LAST_ID - 1000;
    let files: Vec<u64> = data.atoms.iter().map(|a| renumbered(a.id)).collect();
    data.atoms.iter_mut().for_each(|a| a.id = renumbered(a.id));
    let (packing, _) = packing_of(data.clone(), 1, "").unwrap();
    let mut ids: Vec<u64> = files.iter().map(|id| id - 1).collect();
    ids.sort_unstable();
    let of_rows = (0..120).map(|row| u64::from(packing.file.ids.of(row)));
    assert!(of_rows.eq(ids.iter().copied()), "{:?}", packing.file.ids);
    let last = 2 * (ids[119] + 1);
    let expected = format!(
        "f: the id of atom {last} is greater than 4294967296; number the atoms of the file from 1 on"
    );
    assert_eq!(message(packing_of(data, 2, "")), expected);
    for ids in [&[0, 1, 2][..], &[1, 2, 3], &[0, 1, 3, 4, 9], &[u32::MAX]] {
        let jumps = Ids::new(ids.iter().copied());
        let of_rows: Vec<u32> = (0..ids.len() as u32).map(|row| jumps.of(row)).collect();
        assert_eq!(of_rows, ids);
    }
}

/// Distances of near atoms in a tilted box, some of them written outside of it, and in copies.
#[test]
fn boxes_keep_distances() {
    let (length, height, tilt) = (8.0, 6.0, 3.0);
    let place = |k: u32| {
        let part = |n: u32| f64::from(k * n % 97) / 97.0;
        [20.0 * part(31) - 6.0, 15.0 * part(53) - 4.0, 0.0]
    };
    let atom = |k: u32| Atom {
        id: k.into(),
        kind: 1,
        diameter: 0.5,
        density: 1.0,
        position: place(k),
        ..Atom::default()
    };
    let data = DataFile {
        bounds: [[1.0, 1.0 + length], [2.0, 2.0 + height], [-1.0, 1.0]],
        tilt: [tilt, 0.0, 0.0],
        types: 1,
        atoms: (1..=30).map(atom).collect(),
        ..DataFile::default()
    };
    let sorted = |mut all: Vec<f64>| {
        all.retain(|apart| *apart < 2.0);
        all.sort_by(f64::total_cmp);
        all
    };
    let pairs = |n: usize| (0..n).flat_map(|j| (0..j).map(move |i| [i, j]));
    let nearest = |[i, j]: [usize; 2]| {
        let [a, b] = [i, j].map(|k| data.atoms[k].position);
        let images = (-9..=9).flat_map(|n| (-9..=9).map(move |m| [n, m].map(f64::from)));
        let apart = images.map(|[n, m]| {
            let x = a[0] - b[0] + n * length + m * tilt;
            x.hypot(a[1] - b[1] + m * height)
        });
        apart.fold(f64::INFINITY, f64::min)
    };
    let expected = sorted(pairs(30).map(nearest).collect());
    assert!(expected.len() > 50);
    for copies in [[1, 1, 1], [1, 2, 1], [3, 2, 1]] {
        let arrangement = Arrangement {
            copies,
            boundary: &PERIODIC,
        };
        let data = replicated("f", data.clone(), copies, &GrainLimit::default()).unwrap();
        let packing = Packing::new("f", Path::new(FILE), data, arrangement).unwrap();
        let [height, offset] = packing.file.boxed.unwrap();
        let length = packing.file.length;
        assert!(offset.abs() <= 0.5 * length, "{offset}");
        let cell = Cell {
            periods: [length, f64::INFINITY],
            sheared: Some(Sheared {
                offset,
                ..Sheared::upright(height)
            }),
        };
        let inside = |a: &Atom| {
            (0.0..length).contains(&a.position[0]) && (0.0..height).contains(&a.position[1])
        };
        assert!(packing.atoms.iter().all(inside));
        let apart = |[i, j]: [usize; 2]| {
            let [a, b] = [i, j].map(|k| &packing.atoms[k].position);
            gshear_dem::state::length(cell.separation::<Two>(a, b))
        };
        let number = copies.iter().product::<u32>() as usize;
        let found = sorted(pairs(30 * number).map(apart).collect());
        assert_eq!(found.len(), number * expected.len());
        for (found, expected) in found.chunks(number).zip(&expected) {
            assert!(found.iter().all(|found| (found - expected).abs() < 1e-12));
        }
    }
    let walls = Packing::new("f", Path::new(FILE), data, Arrangement::BETWEEN_WALLS);
    let expected = "f: the box is tilted; between walls it must be a rectangle";
    assert_eq!(message(walls), expected);
}

#[test]
fn walls_come_from_types_or_layers() {
    let by = |sets: &str| {
        let mut counts = [0; 3];
        for g in grains(|text| text, sets).unwrap() {
            counts[g.body as usize] += 1;
            if g.body != body::FREE {
                assert_eq!((g.velocity, g.angular_velocity), ([0.0; 3], [0.0; 3]));
            } else if sets != "pack.skip=false" {
                assert!((g.velocity[0] / g.position[1] - 0.1).abs() < 1e-12);
                assert!(g.angular_velocity[2] < 0.0 && g.velocity[1] == 0.001);
            }
        }
        counts
    };
    assert_eq!(by(""), [100, 10, 10]);
    assert_eq!(by("sample.walls=types"), [100, 10, 10]);
    // The second row's centres lie 1.37 diameters high.
    assert_eq!(by("sample.walls=layers"), [100, 10, 10]);
    assert_eq!(by("pack.skip=false"), [120, 0, 0]);
    // Types 1 and 2 alone are no walls.
    let two = |text: String| text.replace(" 3 0.001 2500 ", " 2 0.001 2500 ");
    let (packing, scene) = packing(two, "").unwrap();
    assert!(!packing.file.wall_types);
    assert_eq!(scene.plane_shear("s").unwrap().walls, Walls::Layers);
    let expected = "f: no atom is of type 3; with walls = \"types\" type 2 is the bottom wall and type 3 the top wall";
    assert_eq!(refused(two, "sample.walls=types"), expected);
}

/// Twelve by sixteen columns of nine spheres that overlap by 1e-6 m along z alone.
#[test]
fn force_of_spheres_on_the_top() {
    let at = |n: usize| (n as f64 + 0.5) * 1e-3;
    let row = |n: usize| {
        let (x, y, k) = (at(n / 144), at(n / 9 % 16), n % 9);
        let kind = [2, 1, 1, 1, 1, 1, 1, 1, 3][k];
        let z = 0.5e-3 + 0.999e-3 * k as f64;
        format!("{} {kind} 0.001 2500 {x:e} {y:e} {z:e}\n", n + 1)
    };
    let rows: String = (0..1728).map(row).collect();
    let text = format!(
        "t\n1728 atoms\n3 atom types\n0 0.012 xlo xhi\n0 0.016 ylo yhi\n0 0.01 zlo zhi\nAtoms # sphere\n\n{rows}"
    );
    let (packing, scene) = packing(|_| text.clone(), "dimension=3").unwrap();
    let force = force_on_top(&scene, &packing.grains(&scene).unwrap());
    assert!((force / 192.0 - 1.0).abs() < 1e-9, "{force}");
}

/// A dump says along which axes its box is periodic: between walls along all but the last, in a
/// box along all.
#[test]
fn boxes_that_end_are_not_periodic() {
    let read = |kinds: &str, boxed: bool| {
        let text = format!(
            "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS {kinds}\n0 4\n0 4\n0 4\nITEM: ATOMS id x y z radius\n1 1 1 1 0.5\n"
        );
        let data = parsed("f", text.as_bytes(), None).unwrap();
        let arrangement = Arrangement {
            boundary: if boxed { &PERIODIC } else { &ROUGH_WALLS },
            ..Arrangement::BETWEEN_WALLS
        };
        Packing::new("f", Path::new(FILE), data, arrangement)
    };
    for (kinds, boxed) in [
        ("pp pp ff", false),
        ("xy xz yz pp pp fm", false),
        ("pp pp pp", false),
        ("pp pp pp", true),
        ("", true),
    ] {
        assert!(read(kinds, boxed).is_ok(), "{kinds}");
    }
    for (kinds, boxed, axis, kind) in [
        ("ff pp ff", false, "x", "ff"),
        ("pp sm ff", false, "y", "sm"),
        ("pp pp ff", true, "z", "ff"),
    ] {
        let expected = format!(
            "f: the box is not periodic along {axis} ({kind} in ITEM: BOX BOUNDS), but the sample is; give a packing that is periodic there, or write pp if this one is"
        );
        assert_eq!(message(read(kinds, boxed)), expected);
    }
}

/// Positions along x are wrapped as LAMMPS wraps them, and begin at xlo.
#[test]
fn x_is_wrapped() {
    let moved = with_atom("11 1 0.001 2500 0.00873925 0.0013651593783806542 0");
    let as_it_is = grains(|text| text, "").unwrap();
    for (a, b) in as_it_is.iter().zip(&grains(moved, "").unwrap()) {
        assert!((a.position[0] - b.position[0]).abs() < 1e-17);
    }
}

/// Of each case rows of atoms, or a text and what stands for it.
#[test]
fn what_is_no_packing_of_disks_is_refused() {
    let edited = |text: String, change: &str| match change.split_once(" -> ") {
        Some((from, to)) => text.replace(from, to),
        None => with_atom(change)(text),
    };
    for [changes, expected] in cases(
        r#"
        11 1 0.001 2500 1e300 0.00136 0 | f:19: x of atom 11 is 1e300, more than 1e6 periods from the box, -0.002 0.00799 xlo xhi; give a place in the box
        // Diameters in millimetres.
        0.001 2500 -> 1 2500 | f:34: atom 116 overlaps too many neighbours; check the units of lengths and diameters
        0.001 2500 -> 1e-9 2500 | f: 120 atoms are too few for their box, in which 9.5e13 of the largest diameter, 1e-9, have room; check the units of lengths and diameters
        11 1 0.001 2500 -0.00125075 0.00136 1e-9 | f:19: z of atom 11 is 1e-9; in a packing of disks it is 0
        11 1 0.001 2500 -0.00125075 0.03 0 | f:19: atom 11 is out of the box: y = 0.03, the box has -0.001 0.02 ylo yhi
        -0.0005 0.0005 zlo -> 0.1 0.2 zlo | f: the box is beside the plane z = 0, in which the disks are: 0.1 0.2 zlo zhi
        // Onto atom 32.
        39 1 0.001 2500 -0.0003 0.0030954781351419628 0 | f:22: atom 32 overlaps atom 39 (line 23) by 9.517e-4 m, 95.2 % of the sum of their radii; the law hooke takes 5.000e-4 m
        // Two of one row.
        32 2 0.001 2500 -0.0002517499999999998 0.0030954781351419628 0 & 39 3 0.001 2500 0.00674125 0.0030954781351419628 0 | f:23: atom 39 of type 3 is not above atom 32 of type 2 (line 22): the types are taken as top and bottom wall; give sample.walls = "layers" if they are not
        "#,
    ) {
        let said = refused(|text| changes.split(" & ").fold(text, edited), "");
        assert_eq!(said, expected);
    }
    let two = |text: String| {
        let (head, _) = text.split_once("4 2").unwrap();
        format!("{}4 2 1 1 0 0 0\n", head.replace("120 atoms", "1 atoms"))
    };
    let expected = "s:4: sample.packing: the cell is too narrow for its grains: length = 0.00999 m; give at least 4 diameters of the largest, 4.000e0 m";
    assert_eq!(refused(two, ""), expected);
}
