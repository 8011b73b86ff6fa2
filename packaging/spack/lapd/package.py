# Package for Spack, version 1.0 or later. To use it, put this folder into the folder packages/ of a
# package repository of your own (spack repo create).
#
# NEVER RUN: Spack was not at hand, and there is no release yet. Fill in what is marked
# PLACEHOLDER. cargo takes the crates from crates.io while it builds; Cargo.lock has their hashes.

from spack_repo.builtin.build_systems.cmake import CMakePackage

from spack.package import *


class Lapd(CMakePackage):
    """lapd turns a segmented 3D image (CT, MRI, micro-CT) into a tetrahedral mesh of all its labels
    at once. It has a C library, a C++ header and the program mesh_image."""

    # PLACEHOLDER: addresses of the project, names on GitHub.
    homepage = "https://example.invalid/lapd"
    url = "https://example.invalid/lapd/archive/refs/tags/v0.1.0.tar.gz"
    maintainers("nobody")

    license("MIT OR Apache-2.0", checked_by="nobody")

    # PLACEHOLDER: hash of the release.
    version("0.1.0", sha256="0000000000000000000000000000000000000000000000000000000000000000")

    variant("tools", default=True, description="Build the program mesh_image")
    variant("hwloc", default=False, description="Let hwloc tell which cores share what")

    depends_on("c", type="build")
    depends_on("cmake@3.22:", type="build")
    depends_on("rust@1.92:", type="build")
    with when("+hwloc"):
        depends_on("hwloc@2:")
        depends_on("pkgconfig", type="build")

    conflicts("platform=windows", when="+tools", msg="mesh_image needs a POSIX system")

    def setup_build_environment(self, env: EnvironmentModifications) -> None:
        # Nothing is left in the home of who builds.
        env.set("CARGO_HOME", join_path(self.stage.path, "cargo-home"))

    def cmake_args(self):
        return [
            self.define_from_variant("LAPD_BUILD_TOOLS", "tools"),
            self.define_from_variant("LAPD_HWLOC", "hwloc"),
        ]

    def test_mesh_image(self):
        """the program says its version"""
        if self.spec.satisfies("~tools"):
            raise SkipTest("mesh_image was not built")
        mesh_image = which(self.prefix.bin.mesh_image, required=True)
        output = mesh_image("--version", output=str.split, error=str.split)
        assert str(self.spec.version) in output
