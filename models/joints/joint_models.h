// The joint models that a rig.yaml can name. A new one is added to the list in joint_models.cpp.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "joint_model.h"

namespace kincal {

using JointModels = std::vector<std::shared_ptr<const JointModel>>;

/// Returns the built-in models; their name()s differ.
const JointModels& joint_models();

/// Returns the model with this name; null: there is none.
std::shared_ptr<const JointModel> find_joint_model(const JointModels& models,
                                                   const std::string& name);

}  // namespace kincal
