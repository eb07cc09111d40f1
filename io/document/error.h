// The error of everything that reads the user's files.
#pragma once

#include <stdexcept>

namespace kincal {

/// An InputError is something wrong in the user's input; the text has where (file:line), which
/// field, what is valid.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace kincal
