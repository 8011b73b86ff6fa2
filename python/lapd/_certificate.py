"""The certificate of a mesh, as the report of the C library has it. Nothing is computed here."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields
from typing import Any, Dict, Mapping, Optional, Tuple, Type, TypeVar

T = TypeVar("T")
Position = Tuple[float, float, float]

# How many rows of labels and of defects the text of a certificate has.
_ROWS = 12


@dataclass(frozen=True)
class Distances:
    """Distances between two surfaces, both ways, in the image's units of length.

    `image` stands for the faces between voxels of different labels, `surface` for the smooth
    interfaces that were meshed. All are None unless the certificate is full, and where one of the
    surfaces is empty, as that of a label without tets.
    """

    hausdorff_mesh_to_image: Optional[float]
    """The largest distance from the mesh to the image, to 1/100 of the smallest spacing."""
    hausdorff_image_to_mesh: Optional[float]
    """The largest distance from the image to the mesh."""
    mean_mesh_to_image: Optional[float]
    """The mean distance from the mesh to the image."""
    mean_image_to_mesh: Optional[float]
    """The mean distance from the image to the mesh."""
    hausdorff_mesh_to_surface: Optional[float]
    """The largest distance from the mesh to the smooth interfaces."""
    hausdorff_surface_to_mesh: Optional[float]
    """The largest distance from the smooth interfaces to the mesh."""
    mean_mesh_to_surface: Optional[float]
    """The mean distance from the mesh to the smooth interfaces."""
    mean_surface_to_mesh: Optional[float]
    """The mean distance from the smooth interfaces to the mesh."""


@dataclass(frozen=True)
class LabelRow:
    """One label in the mesh and in the image. Volumes are in cubic units of length.

    A component of the image is made of voxels that are joined with all 26 around them, one of the
    mesh of tets that share a facet, an edge or a vertex.
    """

    label: int
    name: Optional[str]
    """Its name; None if it has none."""
    tets: int
    """Its tets; 0 if the mesh lost it."""
    mesh_volume: float
    """The volume of its tets."""
    image_volume: float
    """The volume of its voxels."""
    image_voxels: int
    """The number of its voxels."""
    components_image: int
    """Its components in the image."""
    components_mesh: int
    """Its components in the mesh."""
    components_lost: int
    """Components of the image, of 8 voxels or more, without a tet of the label."""
    components_merged: int
    """Components of the image, of 8 voxels or more, that the mesh joined to another one."""
    pieces: int
    """Components of the mesh that are torn off, or that lie in no component of the image."""
    euler_image: int
    """The Euler characteristic of its boundary in the image: 2 for a ball, 0 for a torus."""
    euler_mesh: int
    """The Euler characteristic of its boundary in the mesh."""
    non_manifold_edges: int
    """Edges where more than two facets of its boundary meet."""
    non_manifold_vertices: int
    """Vertices, on no such edge, where more than one sheet of its boundary meet."""
    volume_change: float
    """By how much its volume grew when slivers were removed."""
    distances: Distances
    """Distances between its boundary in the mesh and in the image."""


@dataclass(frozen=True)
class ComponentRow:
    """One component of the image, of 8 voxels or more, and what the mesh made of it.

    Volumes are in cubic units of length.
    """

    label: int
    fate: str
    """kept, merged or lost."""
    position: Position
    """The centre of its first voxel, in the world of the image."""
    image_voxels: int
    """The number of its voxels."""
    image_volume: float
    """Their volume."""
    tets: int
    """The tets of the label that lie in it."""
    mesh_volume: float
    """Their volume."""
    components_mesh: int
    """Components of the mesh that belong to it: 1 where all is well, 0 if lost or merged."""
    euler_image: int
    """The Euler characteristic of its boundary in the image."""
    euler_mesh: int
    """That of the components of the mesh that belong to it, added up."""
    distances: Distances
    """Distances between its boundary in the mesh and in the image."""


@dataclass(frozen=True)
class Defect:
    """A place where a label's topology in the mesh is not that of a solid, or of the image."""

    kind: str
    """lost, merged, torn, stray, non_manifold_edge, non_manifold_vertex or dropped."""
    label: int
    position: Position
    """Where, in the world of the image."""
    size: int
    """Voxels of a component of the image, tets of one of the mesh; 0 for an edge or vertex."""


@dataclass(frozen=True)
class LeftTet:
    """A tet whose dihedral angles the removal of slivers could not bring to the target."""

    tet: int
    """Its row in `Mesh.tets`."""
    label: int
    cause: str
    """What was in the way: contact, wall, junction, interface or inside."""
    position: Position
    """Its centroid, in the world of the image."""
    min_dihedral: float
    """Its smallest dihedral angle in degrees."""
    max_dihedral: float
    """Its largest dihedral angle in degrees."""


@dataclass(frozen=True, repr=False)
class Certificate:
    """What was measured on a finished mesh; `Mesh.certificate` makes it.

    It says what the report of the C library says, and decides nothing by itself. What was not
    measured is None, never 0. `print` shows it as a table.
    """

    level: str
    """none; sound, all but distances; or full."""
    limit_reached: Optional[str]
    """The status of the limit that ended the run, if one did: the mesh is partial then."""
    tets: int
    """Tets of the labels."""
    vertices: int
    """Vertices of these tets."""
    interface_facets: int
    """Facets between two labels, or between a label and the background."""
    non_delaunay_facets: Optional[int]
    """Facets that are not locally Delaunay, in the mesh that refinement left."""
    non_delaunay_facets_improved: Optional[int]
    """The same when slivers have been removed, which does not keep the mesh Delaunay."""
    inverted_tets: Optional[int]
    """Tets without positive volume, by exact arithmetic."""
    orphan_vertices: Optional[int]
    """Vertices of no tet."""
    open_edges: Optional[int]
    """Edges where the boundary of a label is not closed."""
    facets_off_walls: Optional[int]
    """Outer facets that should lie on a wall of the image's box, and do not."""
    unmet: Optional[Mapping[str, int]]
    """Elements that refinement left as they are though a rule asks for more, by rule R1 to R6."""
    small_components_lost: Optional[int]
    """Components of the image of fewer than 8 voxels without a tet of their label."""
    min_dihedral: Optional[float]
    """The smallest dihedral angle in degrees."""
    max_dihedral: Optional[float]
    """The largest dihedral angle in degrees."""
    max_radius_edge: Optional[float]
    """The largest circumradius over shortest edge."""
    min_facet_angle: Optional[float]
    """The smallest planar angle of interface facets in degrees."""
    distances: Optional[Distances]
    """Distances between the interfaces of the mesh and those of the image; None unless full."""
    labels: Optional[Tuple[LabelRow, ...]]
    """Each label other than the background, in increasing order."""
    components: Optional[Tuple[ComponentRow, ...]]
    """Each component of the image of 8 voxels or more, in the order of first voxels."""
    defects: Optional[Tuple[Defect, ...]]
    """Where the topology is at fault, by kind."""
    left_tets: Optional[Tuple[LeftTet, ...]]
    """Tets below the target of the dihedral angle; None where slivers were not removed."""

    @classmethod
    def of_report(cls, report: Mapping[str, Any]) -> "Certificate":
        """The certificate in a report, that of `Mesh.report` or of a report's JSON file."""
        measured = report["certificate"] or {}
        full = measured.get("level") == "full"
        improvement = report["improvement"] or {}
        # A target of 0 says that slivers were not removed.
        improved = bool(improvement.get("target_dihedral"))
        after = improvement["non_delaunay_facets"] if improved else None
        return _row(
            cls,
            {**report, **(report["quality"] or {}), **measured},
            level=measured.get("level", "none"),
            non_delaunay_facets_improved=after,
            distances=_row(Distances, measured) if full else None,
            labels=_rows(LabelRow, report["labels"]),
            components=_rows(ComponentRow, report["components"]),
            defects=_rows(Defect, report["defects"]),
            left_tets=_rows(LeftTet, improvement["left_tets"]) if improved else None,
        )

    @property
    def is_delaunay(self) -> Optional[bool]:
        """Whether refinement left a Delaunay mesh; None if that was not measured."""
        return None if self.non_delaunay_facets is None else self.non_delaunay_facets == 0

    @property
    def is_closed(self) -> Optional[bool]:
        """Whether the boundaries of all labels are closed; None if that was not measured."""
        return None if self.open_edges is None else self.open_edges == 0

    def __repr__(self) -> str:
        return "\n".join(line.rstrip() for line in _text(self))


def _row(kind: Type[T], values: Mapping[str, Any], **more: Any) -> T:
    """A dataclass of the values of its names. What a newer library has besides is left out."""
    given: Dict[str, Any] = {f.name: values.get(f.name) for f in fields(kind)}  # type: ignore
    if "position" in given:
        given["position"] = tuple(given["position"])
    if "distances" in given and "distances" not in more:
        given["distances"] = _row(Distances, values)
    return kind(**{**given, **more})


def _rows(kind: Type[T], rows) -> Optional[Tuple[T, ...]]:
    return None if rows is None else tuple(_row(kind, row) for row in rows)


def _number(value: Any, digits: int = 4) -> str:
    """A number as tables show it; a dash where it was not measured."""
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def _text(certificate: Certificate):
    """The lines of the text of a certificate."""
    c = certificate
    yield f"<lapd.Certificate: {c.level}, {c.tets} tets, {c.vertices} vertices>"
    if c.limit_reached is not None:
        yield f"  the mesh is partial: {c.limit_reached}"
    if c.level == "none":
        yield "  nothing was measured: mesh with certificate='sound' or 'full'"
        return
    answer = {None: "not measured", True: "yes", False: "NO"}
    after = c.non_delaunay_facets_improved
    facets = f"{_number(c.non_delaunay_facets)} non-Delaunay facets as refined"
    if after is not None:
        facets += f", {after} after slivers were removed"
    yield f"  Delaunay        {answer[c.is_delaunay]}: {facets}"
    yield (
        f"  closed          {answer[c.is_closed]}: {_number(c.open_edges)} open edges, "
        f"{_number(c.inverted_tets)} inverted tets, {_number(c.orphan_vertices)} orphan vertices, "
        f"{_number(c.facets_off_walls)} facets off walls"
    )
    if c.unmet is None:
        yield "  unmet rules     not measured"
    else:
        unmet = [f"{rule} {count}" for rule, count in c.unmet.items() if count]
        yield f"  unmet rules     {', '.join(unmet) or 'none'}"
    yield f"  dihedral angles {_number(c.min_dihedral)} to {_number(c.max_dihedral)} degrees"
    if c.left_tets is not None:
        yield f"  slivers left    {len(c.left_tets)}"
    yield f"  radius-edge     at most {_number(c.max_radius_edge)}"
    yield f"  facet angles    at least {_number(c.min_facet_angle)} degrees"
    yield from _distances_text(c.distances)
    yield from _labels_text(c)
    yield from _defects_text(c)


def _distances_text(d: Optional[Distances]):
    if d is None:
        yield "  distances       not measured: mesh with certificate='full'"
        return
    yield f"  {'distances':20} {'mean':>8} {'largest':>8}"
    for way in ("mesh_to_image", "image_to_mesh", "mesh_to_surface", "surface_to_mesh"):
        mean, largest = (_number(getattr(d, kind + way)) for kind in ("mean_", "hausdorff_"))
        yield f"    {way.replace('_', ' '):18} {mean:>8} {largest:>8}"


def _labels_text(c: Certificate):
    labels = c.labels or ()
    lost, merged, torn = (
        sum(getattr(row, name) for row in labels)
        for name in ("components_lost", "components_merged", "pieces")
    )
    small = f"{_number(c.small_components_lost)} small ones lost"
    yield f"  components      {lost} lost, {merged} merged, {torn} torn off; {small}"
    shown = labels[:_ROWS]
    wide = max([len("label"), *(len(_called(row)) for row in shown)])
    yield f"  {'':{wide}} {'':>8} {'volume':^21} {'Euler':^13} {'components':^18}"
    yield (
        f"  {'label':{wide}} {'tets':>8} {'mesh':>10} {'image':>10} {'mesh':>6} {'image':>6} "
        f"{'lost':>5} {'merged':>6} {'torn':>5}"
    )
    for row in shown:
        yield (
            f"  {_called(row):{wide}} {row.tets:>8} {_number(row.mesh_volume, 6):>10} "
            f"{_number(row.image_volume, 6):>10} {row.euler_mesh:>6} {row.euler_image:>6} "
            f"{row.components_lost:>5} {row.components_merged:>6} {row.pieces:>5}"
        )
    if len(labels) > len(shown):
        yield f"  ... {len(labels) - len(shown)} labels more: see labels"


def _called(row: LabelRow) -> str:
    return str(row.label) if row.name is None else f"{row.label} {row.name}"


def _defects_text(c: Certificate):
    defects = c.defects or ()
    counts = Counter(_kind(defect) for defect in defects)
    kinds = ", ".join(f"{kind} {count}" for kind, count in counts.items())
    yield f"  defects         {kinds or 'none'}"
    shown = defects[:_ROWS]
    for defect in shown:
        place = ", ".join(f"{x:.5g}" for x in defect.position)
        yield f"    {_kind(defect)}: label {defect.label} at ({place})"
    if len(defects) > len(shown):
        yield f"    ... {len(defects) - len(shown)} more: see defects"


def _kind(defect: Defect) -> str:
    return defect.kind.replace("_", " ").replace("non ", "non-")
