//! The writers: bytes of a small mesh against committed files, and what other programs' readers
//! make of it; timelines as a JSON parser reads them.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use lapd::image::{Wall, WorldAxes};
use lapd::io::write::{WriteOptions, write_mesh, write_mesh_watching, write_timeline};
use lapd::mesh::{NONE, TetMesh};
use lapd::monitor::CancelFlag;
use lapd::refine::activity::{Doing, Span, ThreadReport};

/// Two tets with labels 7 and -2 that share a facet, and one of label 0 on the side of the first.
fn mesh() -> TetMesh {
    const NO: Wall = Wall::None;
    TetMesh {
        points: vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.1, 0.2, 1.5],
            [0.0, 0.0, -1e-7],
            [-1.0, 0.0, 0.0],
        ],
        tets: vec![[0, 1, 2, 3], [0, 2, 1, 4], [0, 2, 5, 3]],
        labels: vec![7, -2, 0],
        neighbors: vec![[NONE, 2, NONE, 1], [NONE, NONE, NONE, 0], [NONE, NONE, 0, NONE]],
        facets: vec![[0, 1, 2], [1, 2, 3], [0, 1, 3], [0, 3, 2], [2, 1, 4], [0, 4, 1], [0, 2, 4]],
        facet_labels: vec![[-2, 7], [7, 0], [7, 0], [7, 0], [-2, 0], [-2, 0], [-2, 0]],
        facet_tets: vec![[1, 0], [0, NONE], [0, NONE], [0, 2], [1, NONE], [1, NONE], [1, NONE]],
        facet_walls: vec![NO, NO, NO, NO, NO, Wall::YMin, NO],
        mid_nodes: None,
    }
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// With `LAPD_UPDATE_GOLDEN` set in the environment, the files are renewed.
#[test]
fn small_mesh_gives_the_committed_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let golden_names = "small.vtk small.mesh small.node small.ele small.face small.msh small.msh2 \
     small.inp small.exo small.mfem small.feb small.bdf small.unv small.stl small.ply small.off";
    for name in golden_names.split(' ') {
        write_mesh(&mesh(), &folder.path().join(name)).unwrap();
    }
    for name in golden_names.split(' ') {
        let written = std::fs::read(folder.path().join(name)).unwrap();
        if std::env::var_os("LAPD_UPDATE_GOLDEN").is_some() {
            std::fs::write(golden().join(name), &written).unwrap();
        }
        let committed = std::fs::read(golden().join(name)).unwrap();
        assert!(
            written == committed,
            "{name} differs from tests/golden: {}",
            String::from_utf8_lossy(&written)
        );
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 16, "temporary files are gone");
}

#[test]
fn any_number_of_threads_writes_the_same_bytes() {
    // Some rounds of batches and blocks, however many threads there are.
    let count = 150_000;
    let mesh = TetMesh {
        points: (0..count).map(|v| [0.1, 0.7, 1.3].map(|x| x * f64::from(v))).collect(),
        tets: (0..count).map(|t| [0, 7, 99, 1000].map(|step| (t + step) % count)).collect(),
        labels: (0..count).map(|t| (t / 1000 % 3) as i32).collect(),
        neighbors: vec![[NONE; 4]; count as usize],
        ..TetMesh::default()
    };
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.vtu", "a.mesh", "a.msh"] {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let path = folder.path().join(name);
            pool.install(|| write_mesh(&mesh, &path).unwrap());
            std::fs::read(path).unwrap()
        };
        assert!(on(1) == on(3), "{name}");
    }
}

/// The uncompressed bytes of the appended array at `offset`.
fn appended(data: &[u8], offset: usize) -> Vec<u8> {
    let word = |i: usize| {
        u64::from_le_bytes(data[offset + 8 * i..offset + 8 * (i + 1)].try_into().unwrap()) as usize
    };
    let blocks = word(0);
    let mut at = offset + 8 * (3 + blocks);
    let mut bytes = Vec::new();
    for block in 0..blocks {
        let size = word(3 + block);
        flate2::read::ZlibDecoder::new(&data[at..at + size]).read_to_end(&mut bytes).unwrap();
        at += size;
    }
    let last = word(2);
    assert_eq!(
        bytes.len(),
        if last == 0 { blocks * word(1) } else { (blocks - 1) * word(1) + last }
    );
    bytes
}

/// VTU bytes depend on the compressor's version; what they hold does not.
#[test]
fn vtu_holds_the_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.vtu");
    // 70000 copies of the tets make several blocks per array.
    for copies in [1, 70_000] {
        let small = mesh();
        let repeated = TetMesh {
            tets: small.tets.repeat(copies),
            labels: small.labels.repeat(copies),
            points: small.points.repeat(copies),
            ..small
        };
        write_mesh(&repeated, &path).unwrap();
        let file = std::fs::read(&path).unwrap();
        let mark = b"<AppendedData encoding=\"raw\">\n_";
        let data = file.windows(mark.len()).position(|window| window == mark).unwrap() + mark.len();
        let xml = std::str::from_utf8(&file[..data]).unwrap();
        let array = |name: &str| {
            let tag = &xml[xml.find(&format!("Name=\"{name}\"")).unwrap()..];
            let offset = tag.split_once("offset=\"").unwrap().1.split_once('"').unwrap().0;
            appended(&file[data..], offset.parse().unwrap())
        };
        let (tets, facets) = (repeated.tets.len(), repeated.facets.len());
        let n = tets + facets;
        assert!(xml.contains(&format!(
            "NumberOfPoints=\"{}\" NumberOfCells=\"{n}\"",
            repeated.points.len()
        )));
        assert_eq!(
            array("label"),
            repeated
                .labels
                .iter()
                .chain(repeated.facet_labels.iter().map(|labels| &labels[0]))
                .flat_map(|x| x.to_le_bytes())
                .collect::<Vec<_>>()
        );
        assert_eq!(
            array("BoundaryLabels")[8 * tets..],
            repeated
                .facet_labels
                .iter()
                .flatten()
                .flat_map(|x| x.to_le_bytes())
                .collect::<Vec<_>>()
        );
        assert_eq!(
            array("boundary"),
            std::iter::repeat_n(0_i32, tets)
                .chain([3, 4, 4, 4, 1, 2, 1])
                .flat_map(|x| x.to_le_bytes())
                .collect::<Vec<_>>()
        );
        assert_eq!(
            array("Points"),
            repeated.points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()
        );
        assert_eq!(
            array("connectivity"),
            repeated
                .tets
                .iter()
                .flatten()
                .chain(repeated.facets.iter().flatten())
                .flat_map(|&v| i64::from(v).to_le_bytes())
                .collect::<Vec<_>>()
        );
        assert_eq!(
            array("offsets"),
            (1..=tets)
                .map(|t| 4 * t)
                .chain((1..=facets).map(|f| 4 * tets + 3 * f))
                .flat_map(|end| (end as i64).to_le_bytes())
                .collect::<Vec<_>>()
        );
        assert_eq!(array("types"), [vec![10; tets], vec![5; facets]].concat());
        for (name, numbers) in [
            ("label_7", "7 3"),
            ("background", "0 3"),
            ("label_-2__background", "1 2"),
            ("label_-2__wall_y_min", "2 2"),
            ("label_-2__label_7", "3 2"),
            ("label_7__background", "4 2"),
        ] {
            let field = format!(
                "Name=\"{name}\" NumberOfTuples=\"2\" format=\"ascii\">{numbers}</DataArray>"
            );
            assert!(xml.contains(&field), "{name} in {xml}");
        }
        assert!(file.ends_with(b"\n</AppendedData>\n</VTKFile>\n"));
    }
}

/// What the world axes mean is said where it is known, in all formats but OFF and universal files,
/// which have no place for it.
#[test]
fn files_tell_their_world_axes() {
    let folder = tempfile::tempdir().unwrap();
    for (world, text) in [
        (WorldAxes::Lps, "SPACE=LPS"),
        (WorldAxes::Ras, "SPACE=RAS"),
        (WorldAxes::Las, "SPACE=LAS"),
    ] {
        let options = WriteOptions { world: Some(world), ..WriteOptions::default() };
        let endings = "vtk mesh node ele face msh msh2 inp exo mfem feb bdf stl ply";
        for ending in endings.split(' ') {
            let path = folder.path().join(format!("a.{ending}"));
            write_mesh_watching(&mesh(), &path, options, None).unwrap();
            let file = std::fs::read(&path).unwrap();
            let count =
                file.windows(text.len()).filter(|window| window == &text.as_bytes()).count();
            assert_eq!(count, 1, "{ending}");
        }
        assert_eq!(
            std::fs::read(folder.path().join("a.stl")).unwrap().len(),
            84 + 50 * mesh().facets.len()
        );
        let path = folder.path().join("a.vtu");
        write_mesh_watching(&mesh(), &path, options, None).unwrap();
        let codes: Vec<String> = text.bytes().skip(6).map(|byte| byte.to_string()).collect();
        let field = format!(
            "Name=\"SPACE\" NumberOfTuples=\"3\" format=\"ascii\">{}</DataArray>",
            codes.join(" ")
        );
        assert!(String::from_utf8_lossy(&std::fs::read(&path).unwrap()).contains(&field));
    }
}

#[test]
fn empty_mesh_makes_whole_files() {
    let folder = tempfile::tempdir().unwrap();
    let endings = "vtu vtk mesh ele msh msh2 inp exo mfem feb bdf unv stl ply off";
    for ending in endings.split(' ') {
        write_mesh(&TetMesh::default(), &folder.path().join(format!("a.{ending}"))).unwrap();
    }
    assert_eq!(std::fs::read(folder.path().join("a.stl")).unwrap().len(), 84);
    assert_eq!(std::fs::read(folder.path().join("a.off")).unwrap(), b"OFF\n0 0 0\n");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 17);
}

/// OpenFOAM's mesh lies in folders beside its file; those that were made for nothing are removed.
#[test]
fn openfoam_has_a_case() {
    let folder = tempfile::tempdir().unwrap();
    let case = folder.path().join("case");
    let path = case.join("small.foam");
    let poly_mesh = case.join("constant/polyMesh");
    write_mesh(&mesh(), &path).unwrap();
    let mut names: Vec<_> = std::fs::read_dir(&poly_mesh)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let expected = ["boundary", "cellZones", "faceZones", "faces", "neighbour", "owner", "points"];
    assert_eq!(names, expected);
    assert_eq!(std::fs::read(&path).unwrap(), b"");
    let boundary = std::fs::read_to_string(poly_mesh.join("boundary")).unwrap();
    assert!(boundary.contains("    label_-2__wall_y_min\n"), "{boundary}");
    write_mesh(&TetMesh::default(), &path).unwrap();

    let flag = CancelFlag::default();
    flag.cancel();
    let other = folder.path().join("other/small.foam");
    let options = WriteOptions::default();
    write_mesh_watching(&mesh(), &other, options, Some(&flag)).unwrap_err();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "folders are left");
}

/// A folder with a file of the small mesh, and those that belong to it: `files` in all. Nothing was
/// left when it was cancelled first. Without HDF5 the ending is refused: `None`.
fn written_with_hdf5(name: &str, files: usize) -> Option<tempfile::TempDir> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    if cfg!(not(feature = "hdf5")) {
        let error = write_mesh(&mesh(), &path).unwrap_err().to_string();
        assert!(error.contains("without HDF5"), "{error}");
        return None;
    }
    let count = || std::fs::read_dir(folder.path()).unwrap().count();
    let flag = CancelFlag::default();
    flag.cancel();
    write_mesh_watching(&mesh(), &path, WriteOptions::default(), Some(&flag)).unwrap_err();
    assert_eq!(count(), 0, "a cancelled file is left");
    write_mesh(&TetMesh::default(), &path).unwrap();
    write_mesh(&mesh(), &path).unwrap();
    assert_eq!(count(), files);
    Some(folder)
}

/// XDMF is two files, both whole or neither there; without HDF5 its ending is refused at once.
#[test]
fn xdmf_comes_with_its_data() {
    let Some(folder) = written_with_hdf5("small.xdmf", 2) else { return };
    let path = folder.path().join("small.xdmf");
    let data = std::fs::read(folder.path().join("small.h5")).unwrap();
    assert!(data.starts_with(b"\x89HDF\r\n\x1a\n"));
    let text = std::fs::read_to_string(&path).unwrap();
    let tets = mesh().tets.len();
    for part in [
        &*format!("TopologyType=\"Tetrahedron\" NumberOfElements=\"{tets}\""),
        "TopologyType=\"Triangle\"",
        "small.h5:/tets",
        "Value=\"label_-2__wall_y_min\"",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    // The second file cannot take its name.
    std::fs::create_dir(folder.path().join("b.xdmf")).unwrap();
    write_mesh(&mesh(), &folder.path().join("b.xdmf")).unwrap_err();
    assert!(!folder.path().join("b.h5").exists());
}

/// VTK's multi-block files are an index and a folder of what it names: all there, or nothing new.
#[test]
fn multi_block_has_a_file_for_each_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a&b.vtm");
    let count = || std::fs::read_dir(folder.path()).unwrap().count();
    let flag = CancelFlag::default();
    flag.cancel();
    write_mesh_watching(&mesh(), &path, WriteOptions::default(), Some(&flag)).unwrap_err();
    assert_eq!(count(), 0, "a cancelled file is left");
    write_mesh(&TetMesh::default(), &path).unwrap();
    write_mesh(&mesh(), &path).unwrap();
    assert_eq!(count(), 2);
    let index = std::fs::read_to_string(&path).unwrap();
    let names = [
        "label_-2",
        "background",
        "label_7",
        "label_-2__background",
        "label_-2__wall_y_min",
        "label_-2__label_7",
        "label_7__background",
    ];
    let mut last = 0;
    for name in names {
        let tag = format!("name=\"{name}\" file=\"a&amp;b/{name}.vtu\"/>");
        let at = index.find(&tag).unwrap_or_else(|| panic!("{tag} is not in {index}"));
        assert!(at > last, "{name} comes too early");
        last = at;
        let block = std::fs::read(folder.path().join(format!("a&b/{name}.vtu"))).unwrap();
        let text = String::from_utf8_lossy(&block);
        assert_eq!(text.matches("NumberOfTuples=\"2\"").count(), 1, "a block has its own name");
        assert!(block.ends_with(b"</VTKFile>\n"));
    }
    assert_eq!(std::fs::read_dir(folder.path().join("a&b")).unwrap().count(), names.len());

    // Files are in the way of the index, of the folder, and of a block.
    let blocked = folder.path().join("index.vtm");
    std::fs::create_dir(&blocked).unwrap();
    write_mesh(&mesh(), &blocked).unwrap_err();
    assert!(!folder.path().join("index").exists());
    std::fs::write(folder.path().join("file"), "").unwrap();
    write_mesh(&mesh(), &folder.path().join("file.vtm")).unwrap_err();
    assert!(!folder.path().join("file.vtm").exists());
    std::fs::create_dir_all(folder.path().join("block/label_7.vtu")).unwrap();
    write_mesh(&mesh(), &folder.path().join("block.vtm")).unwrap_err();
    assert_eq!(std::fs::read_dir(folder.path().join("block")).unwrap().count(), 1);
    let error = write_mesh(&mesh(), &folder.path().join("a:b.vtm")).unwrap_err().to_string();
    assert!(error.contains("without colons"), "{error}");
}

/// VTKHDF needs HDF5, and leaves nothing behind when it ends early.
#[test]
fn vtkhdf_is_one_file() {
    let Some(folder) = written_with_hdf5("small.vtkhdf", 1) else { return };
    let path = folder.path().join("small.vtkhdf");
    assert!(std::fs::read(&path).unwrap().starts_with(b"\x89HDF\r\n\x1a\n"));
}

/// The endings that Gmsh itself knows.
#[test]
fn endings_tell_the_version_of_msh() {
    let folder = tempfile::tempdir().unwrap();
    for (name, start) in [
        ("a.msh", "$MeshFormat\n4.1 1 8\n"),
        ("a.msh4", "$MeshFormat\n4.1 1 8\n"),
        ("a.MSH41", "$MeshFormat\n4.1 1 8\n"),
        ("a.msh2", "$MeshFormat\n2.2 1 8\n"),
        ("a.msh22", "$MeshFormat\n2.2 1 8\n"),
    ] {
        write_mesh(&mesh(), &folder.path().join(name)).unwrap();
        assert!(
            std::fs::read(folder.path().join(name)).unwrap().starts_with(start.as_bytes()),
            "{name}"
        );
    }
}

#[test]
fn errors_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    // The second of TetGen's files cannot take its name: a folder is in the way.
    std::fs::create_dir(folder.path().join("a.ele")).unwrap();
    let error = write_mesh(&mesh(), &folder.path().join("a.node")).unwrap_err().to_string();
    assert!(error.contains("a.ele"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let error = write_mesh(&mesh(), &folder.path().join("a.msh3")).unwrap_err().to_string();
    assert!(error.contains("unknown ending"), "{error}");
}

/// What an independent reader (meshio) sees.
#[test]
fn meshio_reads_what_was_written() {
    if !Command::new("python3")
        .args(["-c", "import meshio"])
        .output()
        .is_ok_and(|output| output.status.success())
    {
        println!("SKIPPED: meshio_reads_what_was_written needs python3 with meshio");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let names = "small.vtu small.vtk small.mesh small.node small.msh small.msh2 small.inp \
     small.bdf small.stl small.off";
    for name in names.split(' ') {
        write_mesh(&mesh(), &folder.path().join(name)).unwrap();
    }
    let script = golden().join("check_with_meshio.py");
    let output = Command::new("python3").arg(script).arg(folder.path()).output().unwrap();
    assert!(
        output.status.success(),
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

/// A thread whose spans follow each other without gaps, at times that are no binary fractions.
fn thread(spans: usize, step: f64) -> ThreadReport {
    const ALL: [Doing; 5] =
        [Doing::Sampling, Doing::Refining, Doing::RollingBack, Doing::Waiting, Doing::Begging];
    let span =
        |i: usize| Span { doing: ALL[i % 5], start: i as f64 * step, end: (i + 1) as f64 * step };
    ThreadReport { timeline: (0..spans).map(span).collect(), ..ThreadReport::default() }
}

#[test]
fn timelines_are_json_in_the_order_of_time() {
    let names = ["sampling", "refining", "rolling back", "waiting", "begging"];
    let threads = [thread(40_001, 1.1e-6), thread(7, 0.3), thread(0, 1.0)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("timeline.json");
    write_timeline(&threads, &path, None).unwrap();
    let trace: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();

    let rows: Vec<_> =
        events.iter().filter(|e| e["name"] == "thread_name").map(|e| &e["args"]["name"]).collect();
    assert_eq!(rows, ["thread 0", "thread 1", "thread 2"]);
    for (row, thread) in threads.iter().enumerate() {
        let spans: Vec<_> = events.iter().filter(|e| e["ph"] == "X" && e["tid"] == row).collect();
        assert_eq!(spans.len(), thread.timeline.len());
        let mut last_end = 0.0;
        for (i, (event, span)) in spans.into_iter().zip(&thread.timeline).enumerate() {
            let [start, duration] = ["ts", "dur"].map(|key| event[key].as_f64().unwrap());
            assert_eq!(event["name"], names[i % 5]);
            // Microseconds, to the nearest nanosecond.
            assert!(
                (start - 1e6 * span.start).abs() < 6e-4
                    && (start + duration - 1e6 * span.end).abs() < 6e-4
            );
            assert!((start - last_end).abs() < 1e-6, "a gap or an overlap at {start}");
            last_end = start + duration;
        }
    }
}
