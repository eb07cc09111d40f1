// The joint models that a rig.yaml can name. A new one is added to the list in joint_models.cpp.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "joint_model.h"

namespace kincal {

using JointModels = std::vector<std::shared_ptr<const JointModel>>;

/// Returns the models that kincal brings along, each with another name().
const JointModels& joint_models();

/// Returns the model of this name; null: there is none.
std::shared_ptr<const JointModel> find_joint_model(const JointModels& models,
                                                   const std::string& name);

}  // namespace kincal
