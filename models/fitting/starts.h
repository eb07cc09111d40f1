// Starting values: closed_form.h, free_targets.h and unknown_poses.h together.
#pragma once

#include "../rig/configuration.h"
#include "../rig/targets.h"
#include "closed_form.h"
#include "free_targets.h"
#include "unknown_poses.h"
