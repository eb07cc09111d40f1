// The error of everything that reads the user's files.
#pragma once

#include <stdexcept>

namespace kincal {

/// An InputError is a mistake in the user's input; its text has the place (file:line), the field,
/// and the valid values.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace kincal
