// The error of everything that reads the user's files.
#pragma once

#include <stdexcept>

namespace kincal {

/// Something in the user's input is wrong; the text says where (file:line), which field, what is valid.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace kincal
