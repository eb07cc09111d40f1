// Monitor and StaticViews for Python.
#pragma once

#include <pybind11/pybind11.h>

namespace kincal {

void add_watching(pybind11::module_& m);

}  // namespace kincal
