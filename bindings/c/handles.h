// What stands behind the handles of kincal.h, and how its functions end: shared by the sources of
// this folder.
#pragma once

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../../io/job/job.h"
#include "../../io/job/robot.h"
#include "../../io/results/read_calibrated.h"
#include "kincal.h"

namespace kincal {

/// A Refusal is an error with its status.
struct Refusal {
  kincal_status status;
  std::string what;
};

/// Names by kind (KINCAL_JOINTS ...).
using NamesByKind = std::array<std::vector<std::string>, 6>;
NamesByKind names_of(const Rig& rig, const ParameterTable& table);
/// Returns null beyond the last one.
const char* name_at(const NamesByKind& names, int32_t kind, size_t index);

/// Tells what is being thrown: the status, and `error` if there is one.
kincal_status tell_thrown(kincal_error* error) noexcept;

/// Does the work of a function of the interface.
template <class Work>
kincal_status guarded(kincal_error* error, const Work& work) noexcept {
  try {
    work();
    return KINCAL_OK;
  } catch (...) {
    return tell_thrown(error);
  }
}

/// Returns what a pointer points to. @throws Refusal: it is null
template <class T>
T& given(T* pointer, const char* argument) {
  if (!pointer) throw Refusal{KINCAL_USAGE, std::string(argument) + ": is NULL"};
  return *pointer;
}

/// Checks the size that a struct begins with. @throws Refusal
template <class T>
const T& sized(const T* from, const char* argument) {
  const T& out = given(from, argument);
  if (out.size < sizeof(T))
    throw Refusal{KINCAL_USAGE, std::string(argument) + ": its size is " +
                                    std::to_string(out.size) + ", not that of a struct (" +
                                    std::to_string(sizeof(T)) + ")"};
  return out;
}

/// Writes a struct that was checked, as far as both versions of it go.
template <class T>
void write_struct(T* to, T from) {
  from.size = to->size;
  std::memcpy(to, &from, sizeof(T));
}

/// Copies a text and cuts it where it is too long, between two characters.
void copy_text(char* to, size_t size, const std::string& from);

/// Copies values to a buffer of the caller, or tells how large it has to be. @throws Refusal
template <class T>
void to_buffer(const std::vector<T>& from, T* buffer, size_t size, size_t* needed) {
  if (needed) *needed = from.size();
  if (!buffer && size == 0) return;
  if (size < from.size())
    throw Refusal{KINCAL_TOO_SMALL, "the buffer has room for " + std::to_string(size) +
                                        ", but there are " + std::to_string(from.size())};
  given(buffer, "buffer");
  std::copy(from.begin(), from.end(), buffer);
}

/// Returns an element. @throws Refusal: there is no such
template <class T>
const T& element(const std::vector<T>& of, size_t index, const char* argument) {
  if (index >= of.size())
    throw Refusal{KINCAL_USAGE, std::string(argument) + ": " + std::to_string(index) +
                                    " is not below " + std::to_string(of.size())};
  return of[index];
}

/// Returns the text; its name becomes `usual` where it has none. @throws Refusal
std::string text_of(const kincal_text* text, const char* argument);
std::string name_of(const kincal_text& text, const char* usual);
/// @throws Refusal
std::vector<std::string> list_of(const kincal_names& names, const char* argument);

/// Returns a text with the 0 behind it.
std::vector<char> with_end(const std::string& text);

/// Writes residuals as structs of `size` bytes, as to_buffer(). @throws Refusal
void residuals_to_buffer(const std::vector<kincal_residual>& from, kincal_residual* buffer,
                         size_t size, size_t count, size_t* needed);

/// @throws Refusal
Progress progress_of(const kincal_progress* progress);

}  // namespace kincal

struct kincal_problem {
  std::shared_ptr<const kincal::KnownRig> rig;
  kincal::SampleSet samples;
  kincal::NamesByKind names;
};

struct kincal_result {
  kincal::ResultFiles files;
  kincal::CalibratedFiles calibrated;
  std::shared_ptr<const kincal::KnownRig> rig, planned;  // as written; null: no compensation
  std::vector<kincal_component> components;
  kincal_summary summary;
  kincal::NamesByKind names;
};

struct kincal_answer {
  std::string json;
  std::vector<std::pair<std::string, std::string>> texts = {};  // others, by name
  std::optional<std::vector<kincal_residual>> residuals = {};
};
