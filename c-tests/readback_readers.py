"""One function per program and format that reads a mesh file and returns what it saw, by nothing
but that program.

Where no program reads a part of a format (Abaqus surfaces, TetGen's .face, the comment lines with
pairs of labels) the part is read here, from the format's manual. What the programs cannot do is
said where it matters.
"""

import re
from dataclasses import dataclass

import numpy as np


@dataclass
class Seen:
    """What a reader saw; None for what the format has not, or the reader does not hand out."""

    points: np.ndarray
    tets: np.ndarray | None = None
    labels: np.ndarray | None = None
    facets: np.ndarray | None = None
    pairs: np.ndarray | None = None  # two labels per facet, and the wall it lies on
    volumes: np.ndarray | None = None  # signed, as computed by the reader
    in_order: bool = True  # points and elements stand in the order of the mesh


WALLS = [f"wall_{axis}_{side}" for axis in "xyz" for side in ("min", "max")]


def pairs_in_comments(path):
    """What "# facets 4: labels 3 7 label_3__label_7" lists, by number from 1."""
    lines = re.findall(
        r"^# facets (\d+): labels (-?\d+) (-?\d+) (\S+)$", path.read_text(), re.MULTILINE
    )
    assert [int(line[0]) for line in lines] == list(range(1, len(lines) + 1)), lines
    pairs = [pair_of(line[3]) for line in lines]
    assert [pair[:2] for pair in pairs] == [[int(line[1]), int(line[2])] for line in lines]
    return np.array(pairs)


def label_of(name):
    return 0 if name == "background" else int(re.fullmatch(r"label_(-?\d+)", name)[1])


def pair_of(name):
    """The two labels and the wall of a boundary, a lapd_wall."""
    first, second = name.split("__")
    if second in WALLS:
        return [label_of(first), 0, WALLS.index(second) + 1]
    return [label_of(first), label_of(second), 0]


def name_of(pair):
    """The name of a boundary."""
    first, second, wall = pair
    other = WALLS[wall - 1] if wall else f"label_{second}" if second else "background"
    return f"label_{first}__{other}"


def region_name(label):
    return f"label_{label}" if label else "background"


# ---- meshio ----


def meshio_volume(path):
    """VTU, VTK, TetGen. meshio takes the first array of integers for the label when it converts;
    ours is the first."""
    import meshio

    mesh = meshio.read(path)
    # TetGen: meshio's name for the first attribute.
    name = "label" if path.suffix in (".vtu", ".vtk") else "tetgen:ref"
    assert next(iter(mesh.cell_data)) == name, mesh.cell_data
    seen = Seen(mesh.points, mesh.cells[0].data, np.ravel(mesh.cell_data[name][0]))
    if path.suffix != ".node":
        assert [block.type for block in mesh.cells] == ["tetra", "triangle"]
        seen.facets = mesh.cells[1].data
        sides, numbers = (mesh.cell_data[key][1] for key in ("BoundaryLabels", "boundary"))
        walls = np.zeros(len(sides), dtype=np.int64)
        # meshio leaves the field data of .vtk out, and with them the names.
        for key, value in mesh.field_data.items():
            if key != "SPACE" and value[1] == 2:
                walls[np.ravel(numbers) == value[0]] = pair_of(key)[2]
        seen.pairs = np.column_stack([sides, walls] if path.suffix == ".vtu" else [sides])
    else:
        assert [block.type for block in mesh.cells] == ["tetra"]
        # meshio leaves the .face file alone. Columns: number, vertices, marker.
        rows = np.loadtxt(
            path.with_suffix(".face"), dtype=np.int64, skiprows=1, comments="#", ndmin=2
        )
        assert np.array_equal(rows[:, 0], np.arange(len(rows)))
        seen.facets = rows[:, 1:4]
        seen.pairs = pairs_in_comments(path.with_suffix(".face"))[rows[:, 4] - 1]
    return seen


def meshio_medit(path):
    import meshio

    mesh = meshio.read(path)
    refs = mesh.cell_data_dict["medit:ref"]
    pairs = pairs_in_comments(path)[refs["triangle"] - 1]
    return Seen(
        mesh.points, mesh.cells_dict["tetra"], refs["tetra"], mesh.cells_dict["triangle"], pairs
    )


def meshio_msh(path):
    """meshio drops the numbers of nodes and elements, so those of version 4.1, which stand by
    entity, have lost their order."""
    import meshio

    mesh = meshio.read(path, file_format="gmsh")
    names = {(int(dim), int(tag)): name for name, (tag, dim) in mesh.field_data.items()}
    # Some programs know groups by their numbers alone.
    assert len({tag for _, tag in names}) == len(names), names
    groups, entities = mesh.cell_data_dict["gmsh:physical"], mesh.cell_data_dict["gmsh:geometrical"]
    for kind in ["tetra", "triangle"]:
        assert np.array_equal(groups[kind], entities[kind])
    return Seen(
        mesh.points,
        mesh.cells_dict["tetra"],
        translate(
            groups["tetra"], {tag: label_of(names[3, tag]) for dim, tag in names if dim == 3}
        ),
        mesh.cells_dict["triangle"],
        translate(
            groups["triangle"], {tag: pair_of(names[2, tag]) for dim, tag in names if dim == 2}
        ),
        in_order=path.suffix == ".msh2",
    )


def translate(tags, meanings):
    """The meaning of every tag."""
    kinds, places = np.unique(tags, return_inverse=True)
    return np.array([meanings[int(kind)] for kind in kinds])[places]


def meshio_abaqus(path):
    """meshio drops the numbers of elements and knows no *SURFACE; both are read here."""
    import meshio

    mesh = meshio.read(path)
    tets = np.concatenate([block.data for block in mesh.cells])
    labels = np.empty(len(tets), dtype=np.int64)
    first = np.cumsum([0] + [len(block) for block in mesh.cells])
    for name, members in mesh.cell_sets.items():
        for block, inside in enumerate(members):
            labels[first[block] + np.asarray(inside, dtype=np.int64)] = label_of(name)
    numbers, sides = [], {}
    section = None
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            section = line
        elif section.startswith("*ELEMENT"):
            numbers.append(int(line.split(",")[0]))
        elif section.startswith("*SURFACE, TYPE=ELEMENT, NAME="):
            sides.setdefault(section.split("=")[-1], []).append(line.split(", "))
    by_number = np.empty((len(tets) + 1, 4), dtype=np.int64)
    by_number[numbers] = tets
    # "C3D4": faces 1-2-3, 1-4-2, 2-4-3, 3-4-1; the normals of these point inwards, so they are
    # turned round.
    corners = {"S1": [0, 2, 1], "S2": [0, 1, 3], "S3": [1, 2, 3], "S4": [2, 0, 3]}
    label_by_number = np.empty(len(tets) + 1, dtype=np.int64)
    label_by_number[numbers] = labels
    facets, pairs = [], []
    for name, rows in sides.items():
        pair = pair_of(name)
        for number, side in rows:
            assert label_by_number[int(number)] == pair[0]
            facets.append(by_number[int(number)][corners[side]])
            pairs.append(pair)
    return Seen(mesh.points, tets, labels, np.array(facets), np.array(pairs), in_order=False)


def meshio_surface(path):
    """STL and OFF. meshio cannot read a binary PLY whose faces have more than vertices."""
    import meshio

    mesh = meshio.read(path)
    return Seen(mesh.points, facets=mesh.cells_dict["triangle"])


# ---- VTK ----


def vtk_output(path):
    """What VTK's reader for the ending makes of the file."""
    import vtk

    reader = {
        ".vtu": vtk.vtkXMLUnstructuredGridReader,
        ".vtk": vtk.vtkUnstructuredGridReader,
        ".vtkhdf": vtk.vtkHDFReader,
        ".vtm": vtk.vtkXMLMultiBlockDataReader,
    }[path.suffix]()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0, reader.GetErrorCode()
    return reader.GetOutputDataObject(0)


def vtk_volumes(grid):
    """Volumes of tets as VTK computes them."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    quality = vtk.vtkMeshQuality()
    quality.SetInputData(grid)
    quality.SetTetQualityMeasureToVolume()
    quality.Update()
    return vtk_to_numpy(quality.GetOutput().GetCellData().GetArray("Quality"))


def vtk_field(grid):
    """Names in the field data, with their numbers."""
    from vtk.util.numpy_support import vtk_to_numpy

    field = grid.GetFieldData()
    names = [field.GetArrayName(i) for i in range(field.GetNumberOfArrays())]
    return {name: vtk_to_numpy(field.GetArray(name)).ravel() for name in names}


def vtk_volume(path):
    """All cells in one grid: .vtu, .vtk, .vtkhdf."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    grid = vtk_output(path)
    kinds = vtk_to_numpy(grid.GetCellTypes())
    tets = int((kinds == vtk.VTK_TETRA).sum())
    assert (kinds[:tets] == vtk.VTK_TETRA).all() and (kinds[tets:] == vtk.VTK_TRIANGLE).all()
    if path.suffix != ".vtkhdf":
        # There no array comes before others.
        assert grid.GetCellData().GetScalars().GetName() == "label"
    nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    cells, numbers = grid.GetCellData(), vtk_field(grid)
    names = list(numbers)
    boundaries = {
        int(numbers[name][0]): pair_of(name) for name in names if list(numbers[name])[1:] == [2]
    }
    labels = vtk_to_numpy(cells.GetArray("label"))
    for name in names:
        if list(numbers[name])[1:] == [3]:
            assert label_of(name) in labels[:tets]
    sides = vtk_to_numpy(cells.GetArray("BoundaryLabels"))
    assert (sides[:tets] == labels[:tets, None]).all()
    assert (sides[tets:, 0] == labels[tets:]).all()
    pairs = translate(vtk_to_numpy(cells.GetArray("boundary"))[tets:], boundaries)
    assert np.array_equal(pairs[:, :2], sides[tets:])
    return Seen(
        vtk_to_numpy(grid.GetPoints().GetData()),
        nodes[: 4 * tets].reshape(-1, 4),
        labels[:tets],
        nodes[4 * tets :].reshape(-1, 3),
        pairs,
        volumes=vtk_volumes(grid)[:tets],
    )


def vtk_blocks(path):
    """The blocks of a .vtm file: their names, each with what kind of block it is, and its grid."""
    import vtk

    output = vtk_output(path)
    name = vtk.vtkCompositeDataSet.NAME()
    kinds = [output.GetMetaData(i).Get(name) for i in range(output.GetNumberOfBlocks())]
    assert kinds == ["regions", "boundaries"], kinds
    blocks = []
    for i, kind in enumerate(kinds):
        group = output.GetBlock(i)
        for j in range(group.GetNumberOfBlocks()):
            blocks.append((kind, group.GetMetaData(j).Get(name), group.GetBlock(j)))
    # Its files are called as the blocks are.
    files = {file.stem for file in path.with_suffix("").iterdir()}
    assert files == {name for _, name, _ in blocks}, files
    return blocks


def vtk_joined(blocks, kind, width):
    """Nodes of the cells of all blocks of a kind, by the coordinates of all blocks' points one
    behind the other."""
    from vtk.util.numpy_support import vtk_to_numpy

    first, rows = 0, []
    for of_kind, _, grid in blocks:
        if of_kind == kind:
            nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, width)
            # A block has the points of its own cells alone.
            assert len(np.unique(nodes)) == grid.GetNumberOfPoints()
            rows.append(first + nodes)
        first += grid.GetNumberOfPoints()
    return np.concatenate(rows)


def vtk_distinct_points(blocks):
    """The points of all blocks, each once, and the place of each block's points among them."""
    from vtk.util.numpy_support import vtk_to_numpy

    points = [vtk_to_numpy(grid.GetPoints().GetData()) for _, _, grid in blocks]
    points, places = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return points, places.ravel()


def vtk_multi_block(path):
    """A block for each region and each boundary."""
    from vtk.util.numpy_support import vtk_to_numpy

    blocks = vtk_blocks(path)
    points, places = vtk_distinct_points(blocks)
    labels, pairs, volumes, numbers = [], [], [], []
    for kind, name, grid in blocks:
        cells, field = grid.GetCellData(), vtk_field(grid)
        field.pop("SPACE")
        assert list(field) == [name], (name, field)
        arrays = [vtk_to_numpy(cells.GetArray(i)) for i in range(cells.GetNumberOfArrays())]
        count = grid.GetNumberOfCells()
        if kind == "regions":
            expected = [label_of(name), [label_of(name)] * 2, 0]
            assert list(field[name]) == [label_of(name), 3], field
            labels += [label_of(name)] * count
            volumes.append(vtk_volumes(grid))
        else:
            pair = pair_of(name)
            numbers.append(field[name][0])
            expected = [pair[0], pair[:2], numbers[-1]]
            assert field[name][1] == 2
            pairs += [pair] * count
        for array, value in zip(arrays, expected, strict=True):
            assert len(array) == count and (array == value).all(), (name, value)
    assert numbers == list(range(1, len(numbers) + 1)), numbers
    return Seen(
        points,
        places[vtk_joined(blocks, "regions", 4)],
        np.array(labels),
        places[vtk_joined(blocks, "boundaries", 3)],
        np.array(pairs),
        np.concatenate(volumes),
        in_order=False,
    )


def vtk_surface(path):
    """PLY, OFF, STL: points and polygons, in single precision; VTK has no other."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = {".ply": vtk.vtkPLYReader, ".off": vtk.vtkOFFReader, ".stl": vtk.vtkSTLReader}[
        path.suffix
    ]()
    if path.suffix == ".stl":
        reader.MergingOff()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    facets = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return Seen(vtk_to_numpy(data.GetPoints().GetData()), facets=facets)


# ---- trimesh ----


def trimesh_surface(path):
    import trimesh

    mesh = trimesh.load(path, process=False)
    seen = Seen(np.asarray(mesh.vertices), facets=np.asarray(mesh.faces))
    if path.suffix == ".ply":
        faces = mesh.metadata["_ply_raw"]["face"]["data"]
        seen.pairs = np.column_stack([faces["first_label"], faces["second_label"]])
    return seen


# ---- gmsh ----


def gmsh_open(path):
    """Opens a file; Gmsh must have nothing to say against it."""
    import gmsh

    gmsh.clear()
    gmsh.logger.start()
    gmsh.open(str(path))
    complaints = [line for line in gmsh.logger.get() if not line.startswith("Info")]
    gmsh.logger.stop()
    assert not complaints, complaints
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    points = np.full((len(numbers), 3), np.nan)
    points[numbers.astype(np.int64) - 1] = coordinates.reshape(-1, 3)
    return points


def gmsh_elements(dimension, entity):
    """Numbers and vertices of the elements of an entity, which are all tets or all triangles."""
    import gmsh

    kinds, numbers, nodes = gmsh.model.mesh.getElements(dimension, entity)
    assert list(kinds) == [{2: 2, 3: 4}[dimension]], (dimension, entity, kinds)
    return numbers[0].astype(np.int64), nodes[0].astype(np.int64).reshape(len(numbers[0]), -1) - 1


def gmsh_gather(points, meaning):
    """All elements of the model, in the order of their numbers, with what `meaning` says of
    their entities."""
    import gmsh

    parts = {2: [], 3: []}
    for dimension, entity in gmsh.model.getEntities():
        numbers, vertices = gmsh_elements(dimension, entity)
        means = np.array([meaning(dimension, entity)] * len(numbers))
        measure = (
            gmsh.model.mesh.getElementQualities(numbers, "volume") if dimension == 3 else numbers
        )
        parts[dimension].append((numbers, vertices, means, measure))
    joined = {}
    for dimension, rows in parts.items():
        columns = [np.concatenate(column) for column in zip(*rows)]
        order = np.argsort(columns[0])
        joined[dimension] = [column[order] for column in columns]
    (_, tets, labels, volumes), (_, facets, pairs, _) = joined[3], joined[2]
    return Seen(points, tets, labels, facets, pairs, volumes)


def gmsh_msh(path):
    """Both versions. Every entity is one physical group of the same tag, whose name tells the
    label or the pair."""
    import gmsh

    points = gmsh_open(path)
    groups = {group: gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
    assert sorted(groups) == sorted(gmsh.model.getEntities())
    for dimension, tag in groups:
        assert list(gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)) == [tag]
    labels = {tag: label_of(name) for (dimension, tag), name in groups.items() if dimension == 3}
    pairs = {tag: pair_of(name) for (dimension, tag), name in groups.items() if dimension == 2}
    assert len(set(labels.values())) == len(labels) and not labels.keys() & pairs.keys(), groups
    assert sorted(pairs.values()) == [pairs[tag] for tag in sorted(pairs)], pairs
    # A positive label is its own tag, those of 0 and below have tags that are no labels.
    for tag, label in labels.items():
        assert tag == label if label > 0 else tag > 0 and tag not in labels.values(), (tag, label)
    if path.suffix == ".msh":
        # Version 4.1 says what bounds a volume; outwards is positive.
        for tag, label in labels.items():
            boundary = {surface for _, surface in gmsh.model.getBoundary([(3, tag)], oriented=True)}
            expected = {i for i, pair in pairs.items() if pair[0] == label} | {
                -i for i, pair in pairs.items() if pair[1] == label
            }
            assert boundary == expected, (label, boundary, expected)
    # Each node belongs to the smallest surface that it is on, or else to a volume that it is in.
    # Gmsh finds that for version 2.2 itself.
    owner = np.zeros(len(points), dtype=np.int64)
    for tag in sorted(pairs, reverse=True):
        owner[gmsh_elements(2, tag)[1]] = tag
    for tag in pairs:
        nodes, _, _ = gmsh.model.mesh.getNodes(2, tag)
        assert np.array_equal(np.sort(nodes) - 1, np.flatnonzero(owner == tag)), tag
    for tag in labels:
        nodes, _, _ = gmsh.model.mesh.getNodes(3, tag)
        vertices = np.unique(gmsh_elements(3, tag)[1])
        assert np.array_equal(np.sort(nodes) - 1, vertices[owner[vertices] == 0]), tag
    return gmsh_gather(
        points, lambda dimension, entity: (labels if dimension == 3 else pairs)[entity]
    )


def gmsh_medit(path):
    """References become tags of entities. For Gmsh's interface a negative tag stands for all
    entities, so such labels cannot be asked for; then only the elements as a whole are."""
    import gmsh

    points = gmsh_open(path)
    if min(entity for _, entity in gmsh.model.getEntities(3)) < 0:
        numbers, tets = gmsh_elements(3, -1)
        order = np.argsort(numbers)
        return Seen(
            points,
            tets[order],
            volumes=gmsh.model.mesh.getElementQualities(numbers[order], "volume"),
        )
    pairs = pairs_in_comments(path)
    return gmsh_gather(
        points, lambda dimension, entity: entity if dimension == 3 else pairs[entity - 1]
    )


# ---- Formats of solvers ----


def gmsh_by_tags(path):
    """Universal files and Nastran's: numbers of entities are tags of regions and boundaries, whose
    names are read here, in the order of which tags go up."""
    points = gmsh_open(path)
    text = path.read_text()
    if path.suffix == ".bdf":
        rows = re.findall(r"^\$ (PSOLID|PSHELL) (\d+): (\S+)$", text, re.MULTILINE)
        names = {(3 if kind == "PSOLID" else 2, int(tag)): name for kind, tag, name in rows}
    else:
        import gmsh

        names = {}
        for name, members in unv_groups(text).items():
            dimension = 2 if "__" in name else 3
            tag = gmsh.model.mesh.getElement(members[0])[3]
            assert len(members) == len(gmsh_elements(dimension, tag)[0]), name
            names[dimension, tag] = name
    return gmsh_gather(
        points,
        lambda dimension, tag: (pair_of if dimension == 2 else label_of)(names[dimension, tag]),
    )


def unv_groups(text):
    """The elements of each group of a universal file: dataset 2467, two elements in a line."""
    lines = iter(text.split("  2467\n")[1].split("    -1\n")[0].splitlines())
    groups = {}
    for head in lines:
        count, name = int(head.split()[-1]), next(lines)
        members = []
        while len(members) < count:
            fields = next(lines).split()
            assert set(fields[::4]) == {"8"}, fields
            members += [int(field) for field in fields[1::4]]
        assert len(members) == count, name
        groups[name] = members
    return groups


def meshio_nastran(path):
    import meshio

    mesh = meshio.read(path)
    refs = mesh.cell_data_dict["nastran:ref"]
    rows = re.findall(r"^\$ (?:PSOLID|PSHELL) (\d+): (\S+)$", path.read_text(), re.MULTILINE)
    names = {int(tag): name for tag, name in rows}
    return Seen(
        mesh.points,
        mesh.cells_dict["tetra"],
        np.array([label_of(names[tag]) for tag in refs["tetra"]]),
        mesh.cells_dict["triangle"],
        np.array([pair_of(names[tag]) for tag in refs["triangle"]]),
    )


def vtk_exodus(path):
    """VTK has Sandia's own library. Side sets are read as polygons with normals out of their
    elements; those of the other side of an interface must be the same, turned round."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkExodusIIReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    sets = [reader.GetSideSetArrayName(i) for i in range(reader.GetNumberOfSideSetArrays())]
    blocks = [
        reader.GetElementBlockArrayName(i) for i in range(reader.GetNumberOfElementBlockArrays())
    ]
    for name in sets:
        reader.SetSideSetArrayStatus(name, 1)
    reader.SetSqueezePoints(False)
    reader.Update()
    output = reader.GetOutput()
    parts = {}
    for i in range(output.GetNumberOfBlocks()):
        of_kind = output.GetBlock(i)
        for j in range(of_kind.GetNumberOfBlocks() if of_kind else 0):
            if of_kind.GetBlock(j):
                name = of_kind.GetMetaData(j).Get(vtk.vtkCompositeDataSet.NAME())
                parts[name.split(" ID")[0].replace("Unnamed block", "")] = of_kind.GetBlock(j)
    assert set(blocks) | set(sets) == set(parts), (blocks, sets, list(parts))
    points = vtk_to_numpy(parts[blocks[0]].GetPoints().GetData())
    tets, labels, sides = [], [], {}
    for name, grid in parts.items():
        nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
        if "__" in name:
            sides[name] = nodes.reshape(-1, 3)
            continue
        tets.append(nodes.reshape(-1, 4))
        labels.append(np.full(len(tets[-1]), label_of(name)))
    facets, pairs = [], []
    for name, nodes in sides.items():
        pair = pair_of(name)
        first, second = pair[:2]
        if first == 0 or (second != 0 and first > second):
            twin = sides["__".join(reversed(name.split("__")))]
            assert np.array_equal(np.sort(nodes, axis=1), np.sort(twin, axis=1)), name
        else:
            facets.append(nodes)
            pairs += [pair] * len(nodes)
    return Seen(
        points,
        np.concatenate(tets),
        np.concatenate(labels),
        np.concatenate(facets),
        np.array(pairs),
        in_order=False,
    )


def febio(path):
    """The mesh of FEBio's file, as XML: solvers.py has it read by a program for such files."""
    import xml.etree.ElementTree as ElementTree

    root = ElementTree.parse(path).getroot()
    assert root.tag == "febio_spec" and root.get("version") == "4.0"
    mesh = root.find("Mesh")

    def rows(element):
        return [[float(x) for x in row.text.split(",")] for row in element]

    tets, labels, numbers, facets, pairs = [], [], [], [], []
    for elements in mesh.findall("Elements"):
        tets += rows(elements)
        labels += [label_of(elements.get("name"))] * len(elements)
        numbers += [int(element.get("id")) for element in elements]
    for surface in mesh.findall("Surface"):
        facets += rows(surface)
        pairs += [pair_of(surface.get("name"))] * len(surface)
    domains = [domain.get("name") for domain in root.find("MeshDomains")]
    assert domains == [elements.get("name") for elements in mesh.findall("Elements")]
    assert sorted(numbers) == list(range(1, len(tets) + 1))
    return Seen(
        np.array(rows(mesh.find("Nodes"))),
        np.array(tets).astype(np.int64) - 1,
        np.array(labels),
        np.array(facets).astype(np.int64) - 1,
        np.array(pairs),
        in_order=False,
    )


def foam_lists(path):
    """The text of a file of OpenFOAM behind its head."""
    return path.read_text().split("}\n", 1)[1]


def foam_numbers(text):
    return np.array(re.sub(r"[()]", " ", text).split(), dtype=np.float64)


def foam_cells(folder):
    """Points, faces, how many of them are inside, and the vertices of cells: those of its faces."""
    points = foam_numbers(foam_lists(folder / "points"))[1:].reshape(-1, 3)
    faces = foam_numbers(foam_lists(folder / "faces"))[1:].reshape(-1, 4)[:, 1:].astype(np.int64)
    owner, neighbour = (
        foam_numbers(foam_lists(folder / name))[1:].astype(np.int64)
        for name in ("owner", "neighbour")
    )
    inner = len(neighbour)
    assert (owner[:inner] < neighbour).all()
    order = np.lexsort([neighbour, owner[:inner]])
    assert np.array_equal(order, np.arange(inner)), "inner faces are not in order"
    count = max(owner.max(), neighbour.max()) + 1
    # Of a cell: a face of it with the normal out of it, and the vertex that is left.
    outward = np.full((count, 3), -1)
    outward[neighbour] = faces[:inner, ::-1]
    outward[owner] = faces
    total = np.zeros(count, dtype=np.int64)
    np.add.at(total, owner, faces.sum(axis=1))
    np.add.at(total, neighbour, faces[:inner].sum(axis=1))
    # Each vertex of a tet is on three of its faces.
    assert (total % 3 == 0).all()
    apex = total // 3 - outward.sum(axis=1)
    return points, faces, inner, np.column_stack([outward[:, ::-1], apex])


def openfoam(path):
    """polyMesh, from the manual; solvers.py has OpenFOAM itself check and solve on it."""
    folder = path.parent / "constant/polyMesh"
    points, faces, inner, tets = foam_cells(folder)
    labels = np.full(len(tets), -(2**40))
    zones = re.findall(
        r"^(\S+)\n\{\n.*?\n\d+\n\(\n(.*?)\)", foam_lists(folder / "cellZones"), re.M | re.S
    )
    for name, members in zones:
        labels[foam_numbers(members).astype(np.int64)] = label_of(name)
    facets, pairs = [], []
    patches = re.findall(
        r"(\S+)\s+\{\s+type\s+patch;\s+nFaces\s+(\d+);\s+startFace\s+(\d+);",
        foam_lists(folder / "boundary"),
    )
    assert sum(int(size) for _, size, _ in patches) == len(faces) - inner
    for name, size, start in patches:
        if name == "outside":
            continue
        facets.append(faces[int(start) : int(start) + int(size)])
        pairs += [pair_of(name)] * int(size)
    zones = re.findall(
        r"^(\S+)\n\{.*?\(\n(.*?)\).*?\(\n(.*?)\)", foam_lists(folder / "faceZones"), re.M | re.S
    )
    for name, members, flips in zones:
        of_zone = faces[foam_numbers(members).astype(np.int64)]
        flipped = foam_numbers(flips).astype(bool)
        of_zone[flipped] = of_zone[flipped][:, ::-1]
        facets.append(of_zone)
        pairs += [pair_of(name)] * len(of_zone)
    return Seen(points, tets, labels, np.concatenate(facets), np.array(pairs), in_order=False)


# Which program reads which file.
READERS = [
    ("meshio", ".vtu", meshio_volume),
    ("vtk", ".vtu", vtk_volume),
    ("meshio", ".vtk", meshio_volume),
    ("vtk", ".vtk", vtk_volume),
    ("vtk", ".vtm", vtk_multi_block),
    ("vtk", ".vtkhdf", vtk_volume),
    ("meshio", ".mesh", meshio_medit),
    ("gmsh", ".mesh", gmsh_medit),
    ("meshio", ".node", meshio_volume),
    ("gmsh", ".msh", gmsh_msh),
    ("meshio", ".msh", meshio_msh),
    ("gmsh", ".msh2", gmsh_msh),
    ("meshio", ".msh2", meshio_msh),
    ("meshio", ".inp", meshio_abaqus),
    ("meshio", ".stl", meshio_surface),
    ("trimesh", ".stl", trimesh_surface),
    ("vtk", ".stl", vtk_surface),
    ("trimesh", ".ply", trimesh_surface),
    ("vtk", ".ply", vtk_surface),
    ("meshio", ".off", meshio_surface),
    ("trimesh", ".off", trimesh_surface),
    ("vtk", ".off", vtk_surface),
    ("vtk", ".exo", vtk_exodus),
    ("gmsh", ".unv", gmsh_by_tags),
    ("gmsh", ".bdf", gmsh_by_tags),
    ("meshio", ".bdf", meshio_nastran),
    ("python", ".feb", febio),
    ("python", ".foam", openfoam),
]
