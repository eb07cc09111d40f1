#include "targets.h"

#include "../../solver/decompositions.h"
#include "numbers.h"

namespace kincal {

Matrix3Xd grid_layout(const GridLayout& grid) {
  std::vector<double> xyz;
  const auto add = [&](double x, double y) { xyz.insert(xyz.end(), {x, y, 0}); };
  const bool tags = grid.kind == GridLayout::Kind::tags;
  const double pitch = tags ? 1 + grid.gap : 1;
  const int skipped =
      grid.kind == GridLayout::Kind::charuco ? 1 : 0;  // its squares meet in inner corners
  for (int r = skipped; r < grid.rows; ++r)
    for (int c = skipped; c < grid.columns; ++c) {
      if (!tags) {
        add(grid.asymmetric ? 2 * c + r % 2 : c, r);
        continue;
      }
      add(c * pitch, r * pitch);
      add(c * pitch + 1, r * pitch);
      add(c * pitch + 1, r * pitch + 1);
      add(c * pitch, r * pitch + 1);
    }
  return Eigen::Map<const Matrix3Xd>(xyz.data(), 3, static_cast<Eigen::Index>(xyz.size() / 3));
}

Eigen::Matrix2Xd warp_shapes(const Matrix3Xd& layout) {
  Eigen::Matrix2Xd out(2, layout.cols());
  for (int k = 0; k < 2; ++k) {
    const double low = layout.row(k).minCoeff(), half = (layout.row(k).maxCoeff() - low) / 2;
    for (Eigen::Index i = 0; i < layout.cols(); ++i) {
      const double u = half > 0 ? (layout(k, i) - low) / half - 1 : 1;
      out(k, i) = 1 - u * u;
    }
  }
  return out;
}

Eigen::Matrix2d print_map(const Eigen::Vector2d& print) {
  return Eigen::Matrix2d::Identity() +
         (Eigen::Matrix2d() << print.x(), print.y(), print.y(), -print.x()).finished() / 2;
}

void set_layout(Target& target, const Matrix3Xd& layout) {
  target.layout = layout;
  if (target.bulge.cols() > 0) target.bulge = warp_shapes(layout);
}

Matrix3Xd target_points(const Target& target) {
  if (!target.grid) return target.points;
  Matrix3Xd points = target.square * target.layout;
  if (target.print) points.topRows<2>() = print_map(*target.print) * points.topRows<2>().eval();
  if (target.bulge.cols() > 0) points.row(2) += target.warp.transpose() * target.bulge;
  return points;
}

Matrix3Xd target_points(const Rig& rig, const ParameterTable& table, const VectorXd& values,
                        int target) {
  const Target& t = rig.targets[target];
  if (t.grid) {
    Matrix3Xd points = values(table.all[table.target_square[target]].start) * t.layout;
    if (const int print = table.target_print[target]; print >= 0)
      points.topRows<2>() =
          print_map(values.segment<2>(table.all[print].start)) * points.topRows<2>().eval();
    if (table.target_warp[target] >= 0)
      points.row(2) +=
          values.segment<2>(table.all[table.target_warp[target]].start).transpose() * t.bulge;
    return points;
  }
  return Eigen::Map<const Matrix3Xd>(values.data() + table.all[table.target_points[target]].start,
                                     3, t.count());
}

std::vector<int> view_ids(const View& view, const Target& target) {
  if (view.ids.empty()) return indices(static_cast<size_t>(target.count()));
  return view.ids;
}

bool on_a_line(const Matrix3Xd& points) {
  if (points.cols() < 3) return true;
  const Matrix3Xd centred = points.colwise() - points.rowwise().mean();
  const VectorXd sizes = singular_values(MatrixXd(centred)).values;
  return sizes(1) <= 1e-6 * (points.rowwise().maxCoeff() - points.rowwise().minCoeff()).maxCoeff();
}

double extent(const Matrix3Xd& points) {
  return (points.rowwise().maxCoeff() - points.rowwise().minCoeff()).norm();
}

bool numbered_by_markers(const Target& target) {
  return target.type == "charuco" || target.type == "apriltag_grid";
}

int points_of_mark(const Target& target) {
  return target.type == "apriltag_grid" || target.type == "marker" ? 4 : 1;
}

std::vector<int> relabeling(const Target& target, const Eigen::Matrix2d& m,
                            const Eigen::Matrix2d& of_mark) {
  const Matrix3Xd& layout = target.layout;
  if (!target.grid || layout.cols() < 3) return {};
  const auto middle = [&](Eigen::Index first, Eigen::Index count) {
    return Eigen::Vector2d(layout.block(0, first, 2, count).rowwise().mean());
  };
  const Eigen::Vector2d centre = middle(0, layout.cols());
  const Eigen::Index of_one = points_of_mark(target);
  std::vector<int> out;
  for (Eigen::Index i = 0; i < layout.cols(); ++i) {
    const Eigen::Vector2d mark = middle(i - i % of_one, of_one),
                          at = centre + m * (mark - centre) +
                               of_mark * (layout.col(i).head<2>() - mark);
    Eigen::Index place = 0;
    if ((layout.topRows<2>().colwise() - at).colwise().norm().minCoeff(&place) > 1e-6) return {};
    out.push_back(static_cast<int>(place));
  }
  return out;
}

void relabel(View& view, const Target& target, const std::vector<int>& places) {
  if (view.ids.empty())
    for (int i = 0; i < target.count(); ++i) view.ids.push_back(i);
  for (int& id : view.ids.own()) id = places[id];
}

}  // namespace kincal
