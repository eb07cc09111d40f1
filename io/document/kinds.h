// What a file is that was given in another's place: arguments in the wrong order, another program's
// file, a compressed one. This header is internal to io.
#pragma once

#include <string>

namespace kincal {

/// What a reader wants, for messages and to know its own.
enum class Wanted { urdf, rig, samples, postures, truth, result, foreign };

/// Does nothing unless the text is plainly something else, judged by its beginning; what is merely
/// wrong is left to the reader. @throws InputError that says what it looks like, what is wanted and
/// what to do
void refuse_other_kinds(const std::string& text, const std::string& path, Wanted wanted);

}  // namespace kincal
