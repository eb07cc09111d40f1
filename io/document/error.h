// The error thrown by all readers of the user's files.
#pragma once

#include <stdexcept>

namespace kincal {

/// An InputError is a mistake in the user's input. Its text states the place (file:line), the field
/// and the valid values.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace kincal
