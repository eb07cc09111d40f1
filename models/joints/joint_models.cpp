#include "joint_models.h"

#include "curve_joint.h"

namespace kincal {

const JointModels& joint_models() {
  static const JointModels models = {linear_joint(), std::make_shared<CurveJoint>()};
  return models;
}

std::shared_ptr<const JointModel> find_joint_model(const JointModels& models,
                                                   const std::string& name) {
  for (const std::shared_ptr<const JointModel>& model : models)
    if (model->name() == name) return model;
  return nullptr;
}

}  // namespace kincal
