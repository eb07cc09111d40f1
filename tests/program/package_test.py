"""What the package asks of others: python3 package_test.py SOURCE_DIR BUILD_DIR CMAKE [TEST ...]

Proves: find_package(kincal) calls find_package() for what the components need and for nothing else, of the build at hand and of one
without CHOLMOD; there the solver, installed alone, is linked and works. A component that is not there gives an error that says why, an
optional one does not. add_subdirectory() leaves variables, properties and settings of the project around it as they were.
CMake shows every find_package() to a "dependency provider" of the test, which refuses what is not expected, whatever is installed
on the system. Does not prove: that the installed files are complete (install_test.py).
"""

import os
import re
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
SOURCE_DIR = BUILD_DIR = CMAKE = None

# Every package that is asked for ends in asked.txt; one that is not expected ends the configuration.
PROVIDER = """
macro(see_package method name)
  file(APPEND ${CMAKE_BINARY_DIR}/asked.txt "${name}\\n")
  if(NOT "${name}" IN_LIST EXPECTED)
    message(FATAL_ERROR "unexpected: find_package(${name})")
  endif()
endmacro()
cmake_language(SET_DEPENDENCY_PROVIDER see_package SUPPORTED_METHODS FIND_PACKAGE)
"""

# kincal inside of another project. Every variable and every property of directory and whole is compared; new are kincal's options, what
# finding packages leaves in the cache, and the usual directories of installation.
AROUND = """
cmake_minimum_required(VERSION 3.25)
project(around VERSION 1.2.3 LANGUAGES CXX)
set(BUILD_SHARED_LIBS ON)
function(state out)
  get_cmake_property(names VARIABLES)
  set(text "")
  foreach(name ${names})
    if(NOT name MATCHES "^(ARG[CNV]|out$|names$|text$|name$|value$|before$|after$)")
      string(APPEND text "variable ${name} = ${${name}}\\n")
    endif()
  endforeach()
  foreach(name COMPILE_DEFINITIONS COMPILE_OPTIONS INCLUDE_DIRECTORIES LINK_DIRECTORIES LINK_LIBRARIES LINK_OPTIONS TESTS
               BUILDSYSTEM_TARGETS IMPORTED_TARGETS)
    get_directory_property(value DIRECTORY ${PROJECT_SOURCE_DIR} ${name})
    string(APPEND text "directory ${name} = ${value}\\n")
  endforeach()
  foreach(name RULE_LAUNCH_COMPILE RULE_LAUNCH_LINK USE_FOLDERS JOB_POOLS FIND_LIBRARY_USE_LIB64_PATHS)
    get_property(value GLOBAL PROPERTY ${name})
    string(APPEND text "global ${name} = ${value}\\n")
  endforeach()
  set(${out} "${text}" PARENT_SCOPE)
endfunction()
state(before)
add_subdirectory(${KINCAL_SOURCE} kincal)
state(after)
file(WRITE ${CMAKE_BINARY_DIR}/before.txt "${before}")
file(WRITE ${CMAKE_BINARY_DIR}/after.txt "${after}")
file(WRITE ${CMAKE_BINARY_DIR}/empty.cpp "int f() { return 0; }")
add_library(around ${CMAKE_BINARY_DIR}/empty.cpp)
add_executable(user ${CMAKE_BINARY_DIR}/empty.cpp)
target_link_libraries(user PRIVATE kincal::models)
"""


def run(*command, code=0):
    """Output of a command that must end with 0, or with another status if `code` is None."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("CMAKE_", "kincal_", "CPATH", "CPLUS", "LIBRARY_PATH"))}
    p = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, timeout=900)
    text = p.stdout.decode(errors="replace")
    if (p.returncode != 0) != (code is None):
        raise AssertionError("%s\nended with %d\n%s" % (" ".join(command), p.returncode, text[-4000:]))
    return text


def cached(build, name):
    with open(os.path.join(build, "CMakeCache.txt")) as f:
        return re.search(r"^%s:\w+=(.*)$" % name, f.read(), re.M).group(1)


class Case(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="kincal_package_")
        self.addCleanup(directory.cleanup)
        self.work, self.count = os.path.realpath(directory.name), 0
        self.prefix = self.path("prefix")
        self.write("provider.cmake", PROVIDER)

    def path(self, *names):
        return os.path.join(self.work, *names)

    def write(self, name, text):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with open(self.path(name), "w") as f:
            f.write(text)

    def configure(self, source, build, *options, code=0):
        return run(CMAKE, "-S", source, "-B", build, "-G", cached(BUILD_DIR, "CMAKE_GENERATOR"),
                   "-DCMAKE_CXX_COMPILER=" + cached(BUILD_DIR, "CMAKE_CXX_COMPILER"), "-DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF", *options, code=code)

    def consumer(self, components, expected, code=0):
        """Configures tests/consumer with these components: what CMake says, the build directory, and the packages asked for."""
        self.count += 1
        build = self.path("consumer%d" % self.count)
        text = self.configure(os.path.join(SOURCE_DIR, "tests", "consumer"), build, "-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_PREFIX_PATH=" + self.prefix,
                              "-DCOMPONENTS=" + components, "-DEXPECTED=kincal;" + ";".join(expected),
                              "-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES=" + self.path("provider.cmake"), code=code)
        with open(os.path.join(build, "asked.txt")) as f:
            return " ".join(text.split()), build, set(f.read().split()) - {"kincal"}


class Solver(Case):
    """The solver alone, of a build without CHOLMOD and without files. It compiles for a minute: only with KINCAL_SLOW."""

    @unittest.skipUnless(os.environ.get("KINCAL_SLOW"), "scripts/test-all sets KINCAL_SLOW")
    def test_asks_for_eigen_and_threads(self):
        build = self.path("build")
        self.configure(SOURCE_DIR, build, "-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS_DEBUG=-O0", "-DKINCAL_CHOLMOD=OFF", "-DKINCAL_IO=OFF",
                       "-DKINCAL_APPS=OFF", "-DKINCAL_TESTS=OFF", "-DEXPECTED=Eigen3;Threads",
                       "-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES=" + self.path("provider.cmake"))
        run(CMAKE, "--build", build, "--target", "kincal_solver", "--parallel", "1")
        run(CMAKE, "--install", build, "--prefix", self.prefix, "--component", "kincal_solver")
        folders = {os.path.relpath(d, self.path("prefix", "include", "kincal")) for d, _, files in os.walk(self.path("prefix", "include")) if files}
        self.assertEqual(folders, {".", "detail/solver"})

        _, consumer, asked = self.consumer("solver", ["Eigen3", "Threads"])
        self.assertEqual(asked, {"Eigen3", "Threads"})
        run(CMAKE, "--build", consumer, "--parallel", "1")
        print(run(os.path.join(consumer, "fit_line")), end="")

        # What is not there, and why.
        for components, why in (("solver;io", "kincal was built without its component io (KINCAL_IO=OFF)"),
                                ("models", "kincal was installed without its component models"),
                                ("kinematics", "kincal was installed without its component kinematics"),
                                ("solver;optics", "kincal has no component optics: its components are kinematics, solver, core, models, io and c")):
            with self.subTest(components=components):
                self.assertIn(why, self.consumer(components, ["Eigen3", "Threads"], code=None)[0])
        _, _, asked = self.consumer("solver;OPTIONAL_COMPONENTS;io;optics", ["Eigen3", "Threads"])
        self.assertEqual(asked, {"Eigen3", "Threads"})
        self.assertEqual(self.consumer("", ["Eigen3", "Threads"])[2], {"Eigen3", "Threads"})  # all that were installed

        # This test itself sees it if the package asks for more.
        config = self.path("prefix", os.path.relpath(cached(consumer, "kincal_DIR"), self.prefix), "kincalConfig.cmake")
        with open(config, "a") as f:
            f.write("find_dependency(ZLIB)\n")
        self.assertIn("unexpected: find_package(ZLIB)", self.consumer("solver", ["Eigen3", "Threads"], code=None)[0])


class Core(Case):
    """The library of a robot's own computer, built alone for size. It compiles for some minutes: only with KINCAL_SLOW."""

    @unittest.skipUnless(os.environ.get("KINCAL_SLOW"), "scripts/test-all sets KINCAL_SLOW")
    def test_is_small_and_asks_for_eigen(self):
        build, program = self.path("build"), self.path("program")
        self.configure(SOURCE_DIR, build, "-DCMAKE_BUILD_TYPE=MinSizeRel", "-DKINCAL_CORE_ONLY=ON", "-DEXPECTED=Eigen3;Threads",
                       "-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES=" + self.path("provider.cmake"))
        run(CMAKE, "--build", build, "--parallel", "1")
        run(CMAKE, "--install", build, "--prefix", self.prefix)
        self.assertIn("kincal was built without its component models (KINCAL_CORE_ONLY=ON)", self.consumer("models", ["Eigen3", "Threads"], code=None)[0])
        self.assertEqual(self.consumer("core", ["Eigen3", "Threads"])[2], {"Eigen3", "Threads"})
        with open(os.path.join(SOURCE_DIR, "docs", "on-a-robot.md")) as f:
            self.write("main.cpp", f.read().split("```cpp\n", 1)[1].split("```", 1)[0])
        libraries = [os.path.join(build, "libkincal_%s.a" % name) for name in ("core", "solver", "kinematics")]
        run(cached(BUILD_DIR, "CMAKE_CXX_COMPILER"), "-std=c++17", "-Os", "-DNDEBUG", "-s", "-I", os.path.join(build, "include"), "-I", "/usr/include/eigen3", self.path("main.cpp"),
            *libraries, "-Wl,--gc-sections", "-lpthread", "-ldl", "-o", program)
        self.assertIn("sensor/tracker/pose has moved since sample 6000", run(program))
        self.assertLess(os.path.getsize(program), 1.5e6)


class Components(Case):
    def test_each_asks_for_its_own(self):
        """The build at hand, with all its components installed."""
        solver = {"Eigen3", "Threads"}
        files = solver | {"pugixml", "yaml-cpp", "nlohmann_json", "PkgConfig"}
        for component in ("models", "core", "solver", "kinematics", "io"):
            if component == "kinematics":
                self.assertIn("kincal was installed without its component kinematics, which models needs", self.consumer("models", solver, code=None)[0])
            run(CMAKE, "--install", BUILD_DIR, "--prefix", self.prefix, "--component", "kincal_" + component)
        if os.path.exists(os.path.join(BUILD_DIR, "libkincal.so")):
            for component in ("kincal_c", "kincal_c_library"):
                run(CMAKE, "--install", BUILD_DIR, "--prefix", self.prefix, "--component", component)
            self.assertEqual(self.consumer("c", [])[2], set())  # everything is inside
        for components, expected in (("kinematics", {"Eigen3"}), ("solver", solver), ("kinematics;solver", solver), ("core", solver), ("models", solver), ("io", files),
                                     ("", files)):
            with self.subTest(components=components):
                self.assertEqual(self.consumer(components, sorted(expected))[2], expected)


class Embedding(Case):
    def test_leaves_the_project_around_it_alone(self):
        """By configuration only. What is compared holds the standard of C++, position-independent code, kind of libraries and all flags."""
        self.write("around/CMakeLists.txt", AROUND)
        build = self.path("build")
        self.configure(self.path("around"), build, "-DCMAKE_BUILD_TYPE=Debug", "-DKINCAL_SOURCE=" + SOURCE_DIR, "-DKINCAL_IO=OFF")

        def read(name):
            with open(os.path.join(build, name)) as f:
                lines = re.split(r"\n(?=variable |directory |global )", f.read())
            return dict(line.split(" = ", 1) for line in lines)

        before, after = read("before.txt"), read("after.txt")
        for name in before:
            self.assertEqual(after.get(name), before[name], name)
        # New in the cache, of the kind that each find_package() leaves.
        allowed = re.compile(r"variable (_?kincal_|KINCAL_|CMAKE_INSTALL_\w*DIR$|Eigen3_DIR$|CHOLMOD_|CMAKE_HAVE_LIBC_PTHREAD$|FIND_PACKAGE_MESSAGE_DETAILS_|_GNUInstallDirs_)")
        self.assertEqual([name for name in sorted(set(after) - set(before)) if not allowed.match(name)], [])
        self.assertEqual([after["variable KINCAL_" + name] for name in ("APPS", "TESTS", "BENCHMARKS")], ["OFF"] * 3)
        self.assertFalse(os.path.exists(os.path.join(build, "compile_commands.json")))
        self.assertEqual(os.listdir(self.path("around")), ["CMakeLists.txt"])


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit("usage: package_test.py SOURCE_DIR BUILD_DIR CMAKE [TEST ...]")
    SOURCE_DIR, BUILD_DIR, CMAKE = os.path.realpath(sys.argv[1]), os.path.realpath(sys.argv[2]), sys.argv[3]
    unittest.main(argv=sys.argv[:1] + sys.argv[4:])
