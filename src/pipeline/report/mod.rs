//! The report of a run as one JSON object: all that is known about a mesh, its arrays apart.
//!
//! Numbers that are infinite or undefined become `null`, as JSON has no other way to say so. The
//! file appears whole or not at all. Members keep their names and meaning from version to version;
//! new ones may come.

mod outline;
mod tables;

use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value};

use super::MeshResult;
use crate::delaunay::worker::Counters;
use crate::image::{LabelNames, WorldAxes};
use crate::improve::{Cause, Improvement};
use crate::io::write::Output;
use crate::memory::room;
use crate::monitor::CancelFlag;
use crate::params::{Adaptive, Algorithm, CertificateLevel, MeshParams};
use crate::refine::activity::Work;
use crate::refine::activity::{Accesses, Overhead, ThreadReport};
use crate::verify::certificate::Certificate;
use crate::verify::quality::{Quality, Spread};
use crate::{Error, Result};
use outline::Outline;
use tables::{Component, DefectJson, Distances, Label};

/// What a report tells beside the result of a run.
#[derive(Clone, Debug, Default)]
pub struct About<'a> {
    /// What the run was asked for; `None` of a mesh that no run made. What a run did is null then.
    pub params: Option<MeshParams>,
    /// What the world axes mean, where that is known.
    pub world: Option<WorldAxes>,
    /// The names of labels.
    pub names: LabelNames,
    /// The values that labels 1, 2, ... stand for, where distinct values became labels.
    pub values: &'a [String],
    /// What only the program knows: members that are put beside those of the library. Those of its
    /// member `seconds` join the library's.
    pub extra: Map<String, Value>,
}

/// Writes the report of a run to `path`, until a flag is raised. An existing file is replaced.
///
/// # Errors
/// [`Error::InvalidArgument`] for an extra member of a name that the library uses, and where
/// `seconds` is no object; [`Error::Io`]; [`Error::Cancelled`]; [`Error::OutOfMemory`].
pub fn write_report(
    result: &MeshResult,
    about: &About<'_>,
    path: &Path,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    let report = Report::new(result, about)?;
    let mut output = Output::create(path)?.watching(cancel);
    output.fill(|out| {
        let mut serializer = serde_json::Serializer::with_formatter(&mut *out, Outline::default());
        report.serialize(&mut serializer)?;
        out.write_all(b"\n")
    })?;
    Output::commit(vec![output])
}

#[derive(Serialize)]
struct Report<'a> {
    version: &'static str,
    world: &'static str,
    delta: Option<f64>,
    size: Option<f64>,
    threads: Option<usize>,
    algorithm: Option<&'static str>,
    limit_reached: Option<&'static str>,
    tets: u64,
    vertices: u64,
    interface_facets: u64,
    all_tets: u64,
    all_vertices: u64,
    oracle_bytes: u64,
    #[serde(flatten)]
    extra: Map<String, Value>,
    seconds: SecondsJson,
    operations: Option<Operations>,
    overhead: Option<OverheadJson>,
    thread_reports: Vec<Thread>,
    quality: Option<QualityJson>,
    topology_differences: Option<Vec<u64>>,
    improvement: Option<ImprovementJson>,
    second_order: Option<SecondOrderJson>,
    certificate: Option<CertificateJson>,
    #[serde(skip_serializing_if = "Map::is_empty")]
    values: Map<String, Value>,
    labels: Option<Vec<Label<'a>>>,
    components: Option<Vec<Component>>,
    defects: Option<Vec<DefectJson>>,
}

/// The names of the members of [`Report`], which nobody else may use.
const MEMBERS: [&str; 26] = [
    "version",
    "world",
    "delta",
    "size",
    "threads",
    "algorithm",
    "limit_reached",
    "tets",
    "vertices",
    "interface_facets",
    "all_tets",
    "all_vertices",
    "oracle_bytes",
    "seconds",
    "operations",
    "overhead",
    "thread_reports",
    "quality",
    "topology_differences",
    "improvement",
    "second_order",
    "certificate",
    "values",
    "labels",
    "components",
    "defects",
];

impl<'a> Report<'a> {
    fn new(result: &MeshResult, about: &'a About<'a>) -> Result<Self> {
        let MeshResult { mesh, report, ended_by } = result;
        let About { params, world, names, values, extra } = about;
        let mut extra = extra.clone();
        let more_seconds = match extra.remove("seconds") {
            None => Map::new(),
            Some(Value::Object(seconds)) => seconds,
            Some(other) => {
                return Err(Error::InvalidArgument(format!(
                    "the member 'seconds' beside a report must be an object, got {other}"
                )));
            }
        };
        if let Some(name) = MEMBERS.into_iter().find(|&name| extra.contains_key(name)) {
            return Err(Error::InvalidArgument(format!(
                "the member '{name}' beside a report is one of the report's own; choose another \
                 name"
            )));
        }
        let vertices = report.all_vertices;
        let params = params.as_ref();
        let name_of = |label| names.get(label).map(|name| &*name.name);
        let volume_change = |label| report.improvement.counts.volume_of(label);
        // What was not measured is null, and never 0.
        let certificate = Some(&report.certificate)
            .filter(|certificate| certificate.level != CertificateLevel::None);
        let label_row = |row| Label::new(row, name_of(row.label), volume_change(row.label));
        Ok(Self {
            version: env!("CARGO_PKG_VERSION"),
            world: world.map_or("unknown", WorldAxes::name),
            delta: params.map(|params| params.delta),
            size: params.map(|params| params.size),
            threads: params.map(|params| params.threads),
            algorithm: params.map(|params| match params.algorithm {
                Algorithm::Podm => "podm",
                Algorithm::Lapd => "lapd",
            }),
            limit_reached: ended_by.as_ref().map(name_of_limit),
            tets: mesh.labels.iter().filter(|&&label| label != 0).count() as u64,
            vertices: mesh.vertex_count() as u64,
            interface_facets: mesh.facets.len() as u64,
            all_tets: report.all_tets,
            all_vertices: vertices,
            oracle_bytes: report.oracle_bytes,
            extra,
            seconds: SecondsJson {
                prepare: report.seconds.prepare,
                refine: report.seconds.refine,
                extract: report.seconds.extract,
                improve: report.seconds.improve,
                certify: report.seconds.certify,
                more: more_seconds,
            },
            operations: params.map(|_| {
                Operations::new(&report.operations, &report.work, vertices, report.all_tets)
            }),
            overhead: params.map(|_| OverheadJson::all(&report.all_threads())),
            thread_reports: filled(&report.threads, "threads", Thread::new)?,
            quality: certificate.map(|_| QualityJson::new(&report.quality)),
            topology_differences: params
                .filter(|params| params.adaptive == Adaptive::Topology)
                .map(|_| report.differences.clone()),
            improvement: params
                .map(|_| ImprovementJson::new(&report.improvement, &mesh.labels))
                .transpose()?,
            second_order: params.map(|_| SecondOrderJson {
                nodes: report.second_order.nodes,
                curved: report.second_order.curving.curved,
                shortened: report.second_order.curving.shortened,
                straight: report.second_order.curving.straight,
                max_move: report.second_order.curving.max_move,
                min_jacobian: report.second_order.curving.min_jacobian,
                volume: report.second_order.curving.volume,
            }),
            certificate: certificate.map(CertificateJson::new),
            values: (1..)
                .zip(values.iter())
                .map(|(label, value): (u32, _)| (label.to_string(), Value::from(value.as_str())))
                .collect(),
            labels: certificate.map(|all| filled(&all.labels, "labels", label_row)).transpose()?,
            components: certificate
                .map(|all| filled(&all.components, "components", Component::new))
                .transpose()?,
            defects: certificate
                .map(|all| filled(&all.defects, "defects", DefectJson::from))
                .transpose()?,
        })
    }
}

/// What `entry` makes of each row.
fn filled<'r, R, T>(
    rows: &'r [R],
    what: &'static str,
    entry: impl FnMut(&'r R) -> T,
) -> Result<Vec<T>> {
    let mut entries = room(rows.len(), what)?;
    entries.extend(rows.iter().map(entry));
    Ok(entries)
}

/// The name of the status that the C interface has for a limit.
fn name_of_limit(limit: &Error) -> &'static str {
    match limit {
        Error::TimeLimit(_) => "LAPD_ERROR_TIME_LIMIT",
        Error::MemoryLimit(_) => "LAPD_ERROR_MEMORY_LIMIT",
        _ => "LAPD_ERROR_LIMIT_REACHED",
    }
}

/// `part` of `whole`; of nothing there is no part, which becomes `null`.
fn ratio(part: u64, whole: u64) -> f64 {
    if whole > 0 { part as f64 / whole as f64 } else { f64::NAN }
}

#[derive(Serialize)]
struct SecondsJson {
    prepare: f64,
    refine: f64,
    extract: f64,
    improve: f64,
    certify: f64,
    #[serde(flatten)]
    more: Map<String, Value>,
}

/// A count for each of the rules.
#[derive(Serialize)]
#[allow(non_snake_case)]
struct ByRule {
    R1: u64,
    R2: u64,
    R3: u64,
    R4: u64,
    R5: u64,
    R6: u64,
}

impl From<[u64; 6]> for ByRule {
    fn from([r1, r2, r3, r4, r5, r6]: [u64; 6]) -> Self {
        Self { R1: r1, R2: r2, R3: r3, R4: r4, R5: r5, R6: r6 }
    }
}

#[derive(Serialize)]
struct Operations {
    insertions: u64,
    removals: u64,
    rollbacks: u64,
    exact_predicates: u64,
    in_sphere_tests: u64,
    tets_created: u64,
    cavity_tets: u64,
    inspections: u64,
    label_lookups: u64,
    crossing_lookups: u64,
    by_rule: ByRule,
    insertions_per_vertex: f64,
    removals_per_vertex: f64,
    mean_cavity: f64,
    exact_share: f64,
    inspections_per_tet: f64,
    lookups_per_tet: f64,
}

impl Operations {
    fn new(counters: &Counters, work: &Work, vertices: u64, tets: u64) -> Self {
        let Counters {
            insertions, removals, exact_predicates, in_sphere_tests, cavity_tets, ..
        } = *counters;
        let lookups = work.lookups;
        Self {
            insertions,
            removals,
            rollbacks: counters.rollbacks,
            exact_predicates,
            in_sphere_tests,
            tets_created: counters.created,
            cavity_tets,
            inspections: work.inspections,
            label_lookups: lookups.labels,
            crossing_lookups: lookups.crossings,
            by_rule: work.by_rule.into(),
            insertions_per_vertex: ratio(insertions, vertices),
            removals_per_vertex: ratio(removals, vertices),
            mean_cavity: ratio(cavity_tets, insertions),
            exact_share: ratio(exact_predicates, in_sphere_tests),
            inspections_per_tet: ratio(work.inspections, tets),
            lookups_per_tet: ratio(lookups.labels + lookups.crossings, tets),
        }
    }
}

/// What one thread, or all of them together, lost time with.
#[derive(Serialize)]
struct OverheadJson {
    rollback_s: f64,
    contention_s: f64,
    idle_s: f64,
    rollbacks_by_rule: ByRule,
    stale: u64,
    waits: u64,
    begs: u64,
    gifts: u64,
    local_accesses: u64,
    remote_accesses: u64,
    access_hops: u64,
    /// Accesses to memory of other nodes are counted, if asked for, and not timed.
    #[serde(skip_serializing_if = "Option::is_none")]
    remote_s: Option<f64>,
}

impl OverheadJson {
    fn new(overhead: &Overhead, accesses: &Accesses) -> Self {
        Self {
            rollback_s: overhead.rollback_seconds,
            contention_s: overhead.contention_seconds,
            idle_s: overhead.idle_seconds,
            rollbacks_by_rule: overhead.rollbacks.into(),
            stale: overhead.stale,
            waits: overhead.waits,
            begs: overhead.begs,
            gifts: overhead.gifts,
            local_accesses: accesses.local(),
            remote_accesses: accesses.remote(),
            access_hops: accesses.hops(),
            remote_s: None,
        }
    }

    fn all(threads: &ThreadReport) -> Self {
        Self { remote_s: Some(0.0), ..Self::new(&threads.overhead, &threads.accesses) }
    }
}

#[derive(Serialize)]
struct Thread {
    insertions: u64,
    removals: u64,
    tets_created: u64,
    rollbacks: u64,
    #[serde(flatten)]
    overhead: OverheadJson,
}

impl Thread {
    fn new(thread: &ThreadReport) -> Self {
        let Counters { insertions, removals, created, rollbacks, .. } = thread.operations;
        let overhead = OverheadJson::new(&thread.overhead, &thread.accesses);
        Self { insertions, removals, tets_created: created, rollbacks, overhead }
    }
}

#[derive(Serialize)]
struct SpreadJson {
    min: f64,
    max: f64,
    histogram: Vec<u64>,
}

impl From<&Spread> for SpreadJson {
    fn from(spread: &Spread) -> Self {
        Self { min: spread.min, max: spread.max, histogram: spread.histogram.to_vec() }
    }
}

#[derive(Serialize)]
struct QualityJson {
    min_dihedral: f64,
    max_dihedral: f64,
    max_radius_edge: f64,
    min_facet_angle: f64,
    dihedral_histogram: Vec<u64>,
    scaled_jacobian: SpreadJson,
    edge_ratio: SpreadJson,
    radius_ratio: SpreadJson,
}

impl QualityJson {
    fn new(quality: &Quality) -> Self {
        Self {
            min_dihedral: quality.min_dihedral,
            max_dihedral: quality.max_dihedral,
            max_radius_edge: quality.max_radius_edge,
            min_facet_angle: quality.min_facet_angle,
            dihedral_histogram: quality.dihedral_histogram.to_vec(),
            scaled_jacobian: (&quality.scaled_jacobian).into(),
            edge_ratio: (&quality.edge_ratio).into(),
            radius_ratio: (&quality.radius_ratio).into(),
        }
    }
}

#[derive(Serialize)]
struct ImprovementJson {
    target_dihedral: f64,
    tolerance: f64,
    below_before: u64,
    left: usize,
    edge_removals: u64,
    interface_flips: u64,
    moves_inside: u64,
    moves_on_interfaces: u64,
    moves_on_junctions: u64,
    splits: u64,
    max_flip: f64,
    max_interface_move: f64,
    max_move: f64,
    non_delaunay_facets: u64,
    nicks_filled: u64,
    contractions: u64,
    tets_before: u64,
    facets_below: u64,
    tets_mended: u64,
    left_tets: Vec<LeftTet>,
}

#[derive(Serialize)]
struct LeftTet {
    tet: u32,
    label: i32,
    cause: &'static str,
    position: [f64; 3],
    min_dihedral: f64,
    max_dihedral: f64,
}

impl ImprovementJson {
    fn new(improvement: &Improvement, labels: &[i32]) -> Result<Self> {
        let Improvement { counts, left, .. } = improvement;
        Ok(Self {
            target_dihedral: improvement.target,
            tolerance: improvement.tolerance,
            below_before: improvement.below_before,
            left: left.len(),
            edge_removals: counts.edge_removals,
            interface_flips: counts.interface_flips,
            moves_inside: counts.moves_inside,
            moves_on_interfaces: counts.moves_on_interfaces,
            moves_on_junctions: counts.moves_on_junctions,
            splits: counts.splits,
            max_flip: counts.max_flip,
            max_interface_move: counts.max_interface_move,
            max_move: improvement.max_move,
            non_delaunay_facets: improvement.non_delaunay_facets,
            nicks_filled: improvement.nicks_filled,
            contractions: counts.contractions,
            tets_before: improvement.tets_before,
            facets_below: improvement.facets_below,
            tets_mended: improvement.tets_mended,
            left_tets: filled(left, "tets that are left", |left| LeftTet {
                tet: left.tet,
                label: labels[left.tet as usize],
                cause: match left.cause {
                    Cause::Contact => "contact",
                    Cause::Wall => "wall",
                    Cause::Junction => "junction",
                    Cause::Interface => "interface",
                    Cause::Inside => "inside",
                },
                position: left.position,
                min_dihedral: left.angles[0],
                max_dihedral: left.angles[1],
            })?,
        })
    }
}

#[derive(Serialize)]
struct SecondOrderJson {
    nodes: u64,
    curved: u64,
    shortened: u64,
    straight: u64,
    max_move: f64,
    min_jacobian: f64,
    volume: f64,
}

#[derive(Serialize)]
struct CertificateJson {
    level: &'static str,
    non_delaunay_facets: Option<u64>,
    inverted_tets: u64,
    orphan_vertices: u64,
    open_edges: u64,
    facets_off_walls: u64,
    small_components_lost: u64,
    #[serde(flatten)]
    distances: Distances,
    unmet: Option<ByRule>,
}

impl CertificateJson {
    fn new(certificate: &Certificate) -> Self {
        Self {
            level: match certificate.level {
                CertificateLevel::None => "none",
                CertificateLevel::Sound => "sound",
                CertificateLevel::Full => "full",
            },
            non_delaunay_facets: certificate.non_delaunay_facets,
            inverted_tets: certificate.inverted_tets,
            orphan_vertices: certificate.orphan_vertices,
            open_edges: certificate.open_edges,
            facets_off_walls: certificate.facets_off_walls,
            small_components_lost: certificate.small_lost.count,
            distances: Distances::new([
                certificate.mesh_to_image,
                certificate.image_to_mesh,
                certificate.mesh_to_surface,
                certificate.surface_to_mesh,
            ]),
            unmet: certificate.unmet.map(ByRule::from),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::image::label_names::LabelName;
    use crate::image::phantom::ball;
    use crate::monitor::Monitor;
    use crate::pipeline::mesh_image;

    #[test]
    fn what_a_program_adds_stands_beside_the_librarys() {
        let image = ball([12; 3], [1.0; 3], 4.0).unwrap();
        let params = MeshParams { delta: 1.5, size: 3.0, ..MeshParams::default() };
        let result = mesh_image(&image, &params, &Monitor::silent()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        let extra = |value: Value| match value {
            Value::Object(extra) => extra,
            _ => unreachable!(),
        };
        let mut names = LabelNames::default();
        names.insert(1, LabelName { name: "the \"ball\"\n".into(), color: None });
        let about = |more| About {
            params: Some(params.clone()),
            names: names.clone(),
            extra: extra(more),
            ..About::default()
        };
        let more = json!({"input": "x.nrrd", "seconds": {"read": 0.5}});
        write_report(&result, &about(more), &path, None).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let report: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["input"], "x.nrrd");
        assert_eq!(report["seconds"]["read"], 0.5);
        assert_eq!(report["seconds"]["refine"], result.report.seconds.refine);
        assert_eq!(report["tets"], result.mesh.tets.len());
        assert_eq!(report["labels"][0]["name"], "the \"ball\"\n");
        assert_eq!(report["components"][0]["fate"], "kept");
        // Every member is one that nobody else may use.
        let members = report.as_object().unwrap();
        assert!(members.keys().all(|name| name == "input" || MEMBERS.contains(&&**name)));
        // A line for each member, and for each row.
        assert!(text.starts_with("{\n  \"version\": \""), "{text}");
        assert!(text.contains("\n  \"labels\": [\n    {\"label\": 1, "), "{text}");
        for wrong in [json!({"tets": 1}), json!({"seconds": 1})] {
            let error = write_report(&result, &about(wrong), &path, None).unwrap_err();
            assert!(matches!(error, Error::InvalidArgument(_)), "{error}");
        }
    }
}
