#include "watching.h"

#include <pybind11/stl.h>

#include <mutex>

#include "../../io/document/json.h"
#include "../../io/job/static_views.h"
#include "../../io/job/watch.h"
#include "../../io/rig/samples_file.h"
#include "text.h"

namespace py = pybind11;

namespace kincal {
namespace {

/// A PyMonitor is a robot that is watched; one thread at a time shows it samples.
struct PyMonitor {
  PyMonitor(const Text& path, double every) : watch(read_calibrated(path), MonitorOptions{every}) {}
  Watch watch;
  std::mutex mutex;
};

/// Shows samples, of which `text` has one a line, and returns what the program prints of each.
std::vector<Text> show_samples(PyMonitor& monitor, const Text& text, const Text& path) {
  const py::gil_scoped_release released;
  const std::lock_guard<std::mutex> lock(monitor.mutex);
  std::vector<Text> out;
  for (const Sample& sample : parse_samples(text, path, monitor.watch.rig()))
    out.push_back(monitor.watch.show(sample).json);
  return out;
}

/// Calibrates a monitored robot again: JSON.
Text recalibrated(PyMonitor& monitor, const Text& text, const Text& path,
                  const std::vector<Text>& groups) {
  const py::gil_scoped_release released;
  const std::lock_guard<std::mutex> lock(monitor.mutex);
  return monitor.watch
      .recalibrated(parse_samples(text, path, monitor.watch.rig()), {groups.begin(), groups.end()})
      .dump();
}

}  // namespace

void add_watching(py::module_& m) {
  py::class_<PyMonitor>(m, "Monitor")
      .def(py::init<const Text&, double>(), py::arg("path"), py::arg("every"))
      .def("show", show_samples, py::arg("text"), py::arg("path"))
      .def("found", [](const PyMonitor& monitor) { return Text(monitor.watch.found().dump()); })
      .def("noise", [](const PyMonitor& monitor) { return Text(monitor.watch.noise().dump()); })
      .def("recalibrated", recalibrated, py::arg("text"), py::arg("path"), py::arg("groups"))
      .def("save", [](const PyMonitor& monitor) { return py::bytes(monitor.watch.save()); })
      .def("load", [](PyMonitor& monitor, const py::bytes& state) { monitor.watch.load(state); })
      .def("summary", [](const PyMonitor& monitor) { return Text(monitor.watch.summary()); });
  py::class_<StaticViews>(m, "StaticViews")
      .def(py::init([](double every, int learning) {
             return StaticViews(StaticViewOptions{every, learning});
           }),
           py::arg("every"), py::arg("learning"))
      .def("show",
           [](StaticViews& views, const Text& text, const Text& path) {
             return Text(views.show(top(parse_json(text, path), path)).json);
           })
      .def("summary", [](const StaticViews& views) { return Text(views.summary()); });
}

}  // namespace kincal
