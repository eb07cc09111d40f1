// Cameras that should stand still, watched: samples as they come, what they show of each camera,
// and whether it has moved; in words and as JSON, as `kincal monitor --static` has it.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../models/monitor/static_view.h"
#include "../document/document.h"
#include "../results/json_values.h"

namespace kincal {

class StaticViews {
 public:
  explicit StaticViews(const StaticViewOptions& options) : options_(options) {}

  struct Told {
    std::string id;
    std::string json;   // {sample, sensors: {NAME: {learning, chi2, dof, probability, left_out,
                        // largest, moved}}}
    std::string words;  // empty: nothing is new
  };
  /// Shows it a sample {id, views: [{sensor, target, ids, pixels}]}; other keys are ignored. A
  /// point is known by target and id. @throws InputError; nothing changes then
  Told show(const Field& sample);

  bool moved() const { return !found_.empty(); }
  /// Returns counts, what has moved and the noise of each camera, in a few lines.
  std::string summary() const;

 private:
  using Point = std::pair<std::string, int>;  // target, id
  struct Picture {
    std::vector<Point> points;
    Eigen::Matrix2Xd pixels;
  };
  struct Camera {
    std::vector<Picture> first;  // until their points are known
    std::vector<std::string> ids;
    std::map<Point, int> index;
    std::vector<Point> points;
    std::vector<StaticView> view;  // none or one
  };
  static std::map<std::string, Picture> read(const Field& sample);
  ViewInnovation add(Camera& camera, const Picture& picture) const;

  StaticViewOptions options_;
  std::map<std::string, Camera> cameras_;
  std::vector<std::string> found_;
  long samples_ = 0;
};

}  // namespace kincal
