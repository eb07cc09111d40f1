#include "progress.h"

namespace kincal {

void throw_cancelled() { throw Cancelled(); }

}  // namespace kincal
