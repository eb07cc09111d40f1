#include "intrinsics_notes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "../../solver/decompositions.h"
#include "../analysis/linearisation.h"
#include "../analysis/residuals.h"
#include "../rig/configuration.h"
#include "../rig/numbers.h"
#include "../rig/scales.h"
#include "../rig/targets.h"
#include "../rig/words.h"

namespace kincal {
namespace {

constexpr double kNearlyParallel = 10 * kPi / 180;  // all boards within this angle
constexpr double kSpoiltNoise = 1.5;     // px; beyond it noise comes of mistakes, not of detection
constexpr double kUnlikeBoard = 0.08;    // what a homography leaves, in sizes of the view
constexpr double kBetterNumbered = 0.3;  // of that left by another number of corners in a row
constexpr int kCornersToJudge = 8;       // of a view, by its homography
constexpr double kFarNoise = 8, kFarPixels = 1;  // a corner that sticks out: in sigmas, px
constexpr double kOfLargest = 0.4;  // the corners of a view that are as far off as its worst
constexpr double kFarView = 3;      // times the middle corner of all views: the middle of a view
constexpr double kFewAreFar = 5;    // times the view's middle: a few corners, not the view
constexpr double kFarChi2 = 100, kProvenChi2 = 25;  // as report/verdict.h has them
constexpr double kFarApart = 5;  // times what each camera leaves: their views are of other moments
constexpr size_t kNamedViews = 5;

using Points2 = Eigen::Matrix2Xd;

/// Points moved and scaled so that they are around 0 and of size 1.
Points2 centred(const Points2& points, double& size) {
  const Points2 out = points.colwise() - Eigen::Vector2d(points.rowwise().mean());
  size = std::sqrt(out.squaredNorm() / static_cast<double>(points.cols()));
  return out / std::max(size, 1e-300);
}

/// What the best homography from a to b leaves: the root mean square distance, in sizes of b.
double homography_misfit(const Points2& a, const Points2& b) {
  double size = 0;
  const Points2 from = centred(a, size), to = centred(b, size);
  MatrixXd rows = MatrixXd::Zero(2 * a.cols(), 9);
  for (Eigen::Index i = 0; i < a.cols(); ++i) {
    const Vector3d p = from.col(i).homogeneous();
    rows.row(2 * i).head<3>() = p.transpose();
    rows.row(2 * i).tail<3>() = -to(0, i) * p.transpose();
    rows.row(2 * i + 1).segment<3>(3) = p.transpose();
    rows.row(2 * i + 1).tail<3>() = -to(1, i) * p.transpose();
  }
  const VectorXd h = symmetric_eigen(rows.transpose() * rows).vectors.col(0);
  double squares = 0;
  for (Eigen::Index i = 0; i < a.cols(); ++i) {
    const Vector3d p = from.col(i).homogeneous();
    const double w = h.tail<3>().dot(p);
    squares +=
        (Eigen::Vector2d(h.head<3>().dot(p), h.segment<3>(3).dot(p)) / w - to.col(i)).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(a.cols()));
}

/// How many corners of a board follow one another in a row; 0 where they do not stand row by row.
int corners_in_row(const Target& target) {
  const Eigen::Matrix3Xd& all = target.layout;
  if (!target.grid || points_of_mark(target) != 1) return 0;
  int columns = 1;
  while (columns < all.cols() && std::abs(all(1, columns) - all(1, 0)) < 1e-9) ++columns;
  if (columns < 2 || columns == all.cols() || all.cols() % columns != 0 ||
      std::abs(all(0, columns) - all(0, 0)) > 1e-9)  // circles whose rows are shifted
    return 0;
  return columns;
}

/// Views and corners that stick out.
struct FarCorners {
  std::vector<std::string> views, corners;
};

/// A view of a board, for its homography.
struct BoardView {
  std::string sample;
  std::vector<int> ids;
  Points2 pixels, points;
  double misfit = 0;
};

std::map<int, std::vector<BoardView>> board_views(const Rig& rig,
                                                  const std::vector<Sample>& samples, int sensor) {
  std::map<int, std::vector<BoardView>> out;
  for (const Sample& sample : samples)
    for (const View& view : sample.views) {
      const Target& target = rig.targets[view.target];
      if (view.sensor != sensor || !target.grid) continue;
      BoardView one;
      one.sample = sample.id;
      one.ids = view_ids(view, target);
      const auto n = static_cast<Eigen::Index>(one.ids.size());
      if (n < kCornersToJudge || static_cast<Eigen::Index>(view.z.size()) != 2 * n) continue;
      one.pixels = Eigen::Map<const Points2>(view.z.data(), 2, n);
      one.points.resize(2, n);
      for (Eigen::Index i = 0; i < n; ++i)
        one.points.col(i) = target.layout.col(one.ids[i]).head<2>();
      one.misfit = homography_misfit(one.points, one.pixels);
      out[view.target].push_back(std::move(one));
    }
  return out;
}

double middle_misfit(const std::vector<BoardView>& views) {
  std::vector<double> all;
  for (const BoardView& view : views) all.push_back(view.misfit);
  return median(all, 0);
}

/// The same with corners numbered row by row, so many in a row, from another number on.
double middle_misfit(const std::vector<BoardView>& views, int in_row, int first = 0) {
  std::vector<double> all;
  for (const BoardView& view : views) {
    Points2 points = view.points;
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      points.col(i) =
          Eigen::Vector2d((view.ids[i] - first) % in_row, (view.ids[i] - first) / in_row);
    all.push_back(homography_misfit(points, view.pixels));
  }
  return median(all, 0);
}

/// What to say of a board whose corners are numbered otherwise than the rig has it; "": nothing.
std::string numbering_text(const Target& target, const std::vector<BoardView>& views) {
  const int columns = corners_in_row(target);
  const double now = middle_misfit(views);
  if (columns == 0 || !(now > kUnlikeBoard)) return "";
  const int rows = target.count() / columns;
  int best = 0;
  double least = kBetterNumbered * now;
  for (const int in_row : {rows, columns - 1, columns + 1}) {
    if (in_row < 2 || in_row == columns) continue;
    const double left = middle_misfit(views, in_row);
    if (left < least) least = left, best = in_row;
  }
  for (const int first : {-1, 1})
    if (middle_misfit(views, columns, first) < least)
      return "the corners of board '" + target.name + "' are numbered one too " +
             (first > 0 ? "high" : "low") + ": ids count from 0, row by row. Write every id " +
             (first > 0 ? "less" : "more") + " by one";
  if (best == 0) return "";
  const std::string board = "targets." + target.name;
  if (best == rows)
    return "rows and columns of board '" + target.name +
           "' are exchanged: its corners are numbered in rows of " + std::to_string(rows) +
           ", the rig has " + std::to_string(columns) + " in a row. Exchange " + board +
           ".rows and .columns in the rig, or number the corners row by row";
  return "the corners of board '" + target.name + "' are numbered in rows of " +
         std::to_string(best) + ", the rig has " + std::to_string(columns) + " in a row. Correct " +
         board + ".columns: of a chessboard inner corners count, of a charuco board squares";
}

/// The corner without which a view is like its board; -1: there is no such corner.
int spoiling_corner(const BoardView& view) {
  const Eigen::Index n = view.points.cols();
  for (Eigen::Index k = 0; n > kCornersToJudge && k < n; ++k) {
    Points2 points(2, n - 1), pixels(2, n - 1);
    points << view.points.leftCols(k), view.points.rightCols(n - 1 - k);
    pixels << view.pixels.leftCols(k), view.pixels.rightCols(n - 1 - k);
    if (homography_misfit(points, pixels) < kBetterNumbered * view.misfit) return view.ids[k];
  }
  return -1;
}

/// Views, or single corners of them, that are unlike their board while the other views are like it.
FarCorners strange_corners(const std::vector<BoardView>& views) {
  const double usual = middle_misfit(views);
  FarCorners out;
  for (const BoardView& view : views) {
    if (!(view.misfit > kUnlikeBoard && view.misfit > 4 * usual)) continue;
    const int corner = spoiling_corner(view);
    if (corner >= 0)
      out.corners.push_back(quoted(view.sample) + " (id " + std::to_string(corner) + ")");
    else
      out.views.push_back(quoted(view.sample));
  }
  return out;
}

/// What to say of pixels that are [v, u]: the board is mirrored in all views, and the corners are
/// those of an image that is as high as the rig's is wide; "": nothing.
std::string exchanged_text(const Sensor& camera, const Target& target,
                           const std::vector<BoardView>& views) {
  long mirrored = 0;
  double right = 0, bottom = 0, size = 0;
  for (const BoardView& view : views) {
    const Eigen::Matrix2d turn =
        centred(view.pixels, size) * centred(view.points, size).transpose();
    mirrored += (turn.determinant() < 0) != target.y_up;
    right = std::max(right, view.pixels.row(0).maxCoeff());
    bottom = std::max(bottom, view.pixels.row(1).maxCoeff());
  }
  const double width = camera.image_width - 0.5, height = camera.image_height - 0.5;
  const bool inside = right <= width && bottom <= height,
             turned = right <= height && bottom <= width;
  if (10 * mirrored < 9 * static_cast<long>(views.size()) || width <= 0 || inside || !turned)
    return "";
  return text(
      "u and v of the pixels are exchanged: board '%s' is mirrored in its views, and "
      "corners reach to (%.0f, %.0f) in an image of %d x %d px. Write pixels as [u, v], u "
      "to the right and v down",
      target.name.c_str(), right, bottom, camera.image_width, camera.image_height);
}

// ------------------------------------------------------------------------------------------------
// after the fit
const ParameterEstimate& intrinsics_of(const FittedLens& fit) {
  return fit.solution["sensor/" + fit.solution.rig().sensors[fit.sensor].name + "/intrinsics"];
}

/// The share of the noise that says how well a lens is known: beyond that it comes of mistakes.
double counted_share(double noise) { return noise > kSpoiltNoise ? kSpoiltNoise / noise : 1; }

/// How to record, where the views determine too little.
std::string recording_advice(const FittedLens& fit) {
  if (fit.views < 3)
    return text(
        "%ld view%s; each view of a flat board determines two of the four intrinsics: show it at "
        "least "
        "three times, turned differently",
        fit.views, fit.views == 1 ? "" : "s");
  if (fit.tilt < kNearlyParallel)
    return text(
        "The boards of all views are parallel within %.2g degrees, so that the focal length trades "
        "off "
        "with their distance: tilt the board by 20 to 45 degrees, to all sides",
        fit.tilt * 180 / kPi);
  return "Show the board tilted to all sides, near the edges of the image as well";
}

void note_undetermined(const FittedLens& fit, std::vector<IntrinsicsNote>& out) {
  const std::string name = "'" + fit.solution.rig().sensors[fit.sensor].name + "': ";
  const ParameterEstimate& lens = intrinsics_of(fit);
  const bool undetermined = is_undetermined(fit);
  const double share = counted_share(fit.noise);
  std::string unknown, loose;
  for (size_t c = 0; c < lens.sigma.size(); ++c) {
    const double sigma = share * lens.sigma[c], focal = std::abs(lens.value[0]);
    if (!std::isfinite(sigma))
      unknown += (unknown.empty() ? "" : ", ") + lens.components[c];
    else if (sigma > scales(ParameterKind::intrinsics, "px", focal).yardstick ||
             (undetermined && fit.views < 2))
      loose +=
          (loose.empty() ? "" : ", ") + lens.components[c] + text(" +- %.3g px", lens.sigma[c]);
  }
  if (undetermined) {
    if (!loose.empty()) unknown += (unknown.empty() ? "" : ", ") + loose;
    out.push_back({"undetermined",
                   name + "the views do not determine " + unknown + ". " + recording_advice(fit)});
  } else if (!loose.empty()) {
    out.push_back({"weak", name + "hardly determined: " + loose + ". " + recording_advice(fit)});
  }
}

/// Sorts a view that sticks out: a few of its corners that are far off move its board a little, so
/// that only what is far off the others of the view counts; where many are, it is the view.
void add_far(const std::string& sample, const std::vector<int>& ids,
             const std::vector<double>& sizes, double usual, FarCorners& out) {
  const double most = *std::max_element(sizes.begin(), sizes.end()), middle = median(sizes, 0);
  std::vector<std::string> far;
  for (size_t k = 0; k < sizes.size(); ++k)
    if (sizes[k] > kOfLargest * most) far.push_back(std::to_string(ids[k]));
  if (most < kFewAreFar * middle && middle > kFarView * usual)
    out.views.push_back(quoted(sample) + text(" (%.3g px)", most));
  else
    out.corners.push_back(quoted(sample) + (far.size() > 1 ? " (ids " : " (id ") + listed(far) +
                          text(", %.3g px)", most));
}

FarCorners far_corners(const Solution& solution, int sensor) {
  const Residuals found = residuals(linearise(solution));
  std::vector<double> all;
  std::vector<std::vector<double>> by_view(found.after.size());
  for (size_t i = 0; i < found.after.size(); ++i) {
    const ViewResiduals& v = found.after[i];
    if (v.view->sensor != sensor || !v.raw.allFinite()) continue;
    for (Eigen::Index k = 0; k + 1 < v.raw.size(); k += 2)
      by_view[i].push_back(v.raw.segment<2>(k).norm());
    all.insert(all.end(), by_view[i].begin(), by_view[i].end());
  }
  const double usual = median(all, 0),
               sigma = usual / std::sqrt(2 * std::log(2)),  // of Rayleigh's distribution
      bound = std::max(kFarPixels, kFarNoise * sigma);
  FarCorners out;
  for (size_t i = 0; i < by_view.size(); ++i) {
    const ViewResiduals& v = found.after[i];
    if (std::any_of(by_view[i].begin(), by_view[i].end(), [&](double r) { return r > bound; }))
      add_far(solution.samples()[v.sample].id,
              view_ids(*v.view, solution.rig().targets[v.view->target]), by_view[i], usual, out);
  }
  return out;
}

void note_far_corners(const FittedLens& fit, std::vector<IntrinsicsNote>& out) {
  const FarCorners far = far_corners(fit.solution, fit.sensor);
  const std::string name = "'" + fit.solution.rig().sensors[fit.sensor].name + "': ";
  if (!far.views.empty())
    out.push_back(
        {"outlier_view",
         name +
             text("%zu view%s the others: sample ", far.views.size(),
                  far.views.size() == 1 ? " does not belong to" : "s do not belong to") +
             listed(far.views, kNamedViews) +
             ". Look at these pictures (blurred, another board, corners in another order), take "
             "the views out of the samples, and calibrate again"});
  if (!far.corners.empty() && far.views.empty())  // else they may follow from the views
    out.push_back({"outlier_point",
                   name + "corners far off the others: sample " + listed(far.corners, kNamedViews) +
                       ". Take these corners out of the samples, and calibrate again"});
  if (far.views.empty() && far.corners.empty() && fit.noise > kSpoiltNoise)
    out.push_back({"noise", name + text("corners are off by %.3g px: wrong corners, a board that "
                                        "differs from the rig's, or a lens unlike %s",
                                        fit.noise, fit.lens.c_str())});
}

/// The boards of a camera seen from behind: a mirrored image of a flat board looks like that.
void note_mirrored(const FittedLens& fit, std::vector<IntrinsicsNote>& out) {
  const Solution& solution = fit.solution;
  const Rig& rig = solution.rig();
  long behind = 0, all = 0;
  std::string board;
  for (const int i : solution.training())
    for (const View& view : solution.samples()[i].views) {
      const Target& target = rig.targets[view.target];
      const auto pose = solution.values.targets.find({i, view.target});
      if (view.sensor != fit.sensor || !target.grid || pose == solution.values.targets.end())
        continue;
      const Configuration at(rig, solution.table(), solution.values.shared,
                             solution.samples()[i].readings);
      const Pose seen = inverse(at.base_T_sensor(fit.sensor)) * pose->second;
      const double away =
          seen.rotation.col(2).dot(seen * Vector3d(target_points(target).rowwise().mean()));
      behind += (away < 0) != target.y_up;
      ++all;
      board = target.name;
    }
  if (behind <= 0.8 * static_cast<double>(all)) return;
  const double last = fit.image.x() - 1;
  out.push_back(
      {"mirrored",
       "'" + rig.sensors[fit.sensor].name + "': board '" + board +
           "' is seen from behind in all views, or nearly: the pixels are mirrored, and the "
           "principal point with them, or its corners are numbered in mirrored order. " +
           text("Of a mirrored picture, take %.0f - u for u (or likewise v); of corners numbered "
                "from another side, number rows from the top and columns from the left: the lens "
                "stays as it is then",
                last)});
}

void note_image_size(const FittedLens& fit, std::vector<IntrinsicsNote>& out) {
  const Sensor& camera = fit.solution.rig().sensors[fit.sensor];
  const std::string name = "'" + camera.name + "': ";
  const int width = camera.image_width, height = camera.image_height;
  if (width <= 0) {
    out.push_back({"image_size", name + text("the rig has no image_size; the range of the corners, "
                                             "%.0f x %.0f px, is used as the image",
                                             fit.image.x(), fit.image.y())});
    return;
  }
  long outside = 0;
  double right = 0, bottom = 0;
  for (const Sample& sample : fit.solution.samples())
    for (const View& view : sample.views)
      for (size_t i = 0; view.sensor == fit.sensor && i + 1 < view.z.size(); i += 2) {
        const double u = view.z[i], v = view.z[i + 1];
        outside += !(u >= -0.5 && u <= width - 0.5 && v >= -0.5 && v <= height - 0.5);
        right = std::max(right, u), bottom = std::max(bottom, v);
      }
  const std::string reach = text("corners reach to (%.0f, %.0f)", right, bottom);
  if (outside > 0) {
    const bool exchanged = right <= height - 0.5 && bottom <= width - 0.5;
    out.push_back(
        {"image_size",
         name +
             text("%ld of %ld corners lie outside of the image of %d x %d px that the rig "
                  "states, ",
                  outside, fit.points, width, height) +
             reach +
             (exchanged ? text(": width and height are exchanged? It would be image_size: [%d, %d]",
                               height, width)
                        : ": correct image_size, or detect in pictures of that size")});
    return;
  }
  const std::vector<double>& lens = intrinsics_of(fit).value;
  const bool corner = right < 0.6 * width && bottom < 0.6 * height && lens[2] < 0.35 * width &&
                      lens[3] < 0.35 * height;
  if (corner)
    out.push_back(
        {"image_size",
         name + text("the rig states an image of %d x %d px, but ", width, height) + reach +
             text(" only, and the principal point (%.0f, %.0f) is far from the middle: were the "
                  "corners found in smaller pictures? State their image_size",
                  lens[2], lens[3])});
}

}  // namespace

std::vector<IntrinsicsNote> wrong_views(const Rig& rig, const std::vector<Sample>& samples,
                                        int sensor) {
  std::vector<IntrinsicsNote> out;
  const std::string name = "'" + rig.sensors[sensor].name + "': ";
  for (const auto& [t, views] : board_views(rig, samples, sensor)) {
    const Target& target = rig.targets[t];
    const std::string numbering = numbering_text(target, views);
    const std::string exchanged = exchanged_text(rig.sensors[sensor], target, views);
    const FarCorners strange = strange_corners(views);
    if (!exchanged.empty()) out.push_back({"exchanged", name + exchanged, true});
    if (!numbering.empty())
      out.push_back({"rows_columns", name + numbering});
    else if (middle_misfit(views) > kUnlikeBoard)
      out.push_back({"board", name + "what it sees is not board '" + target.name +
                                  "' as in the rig: check its rows and columns, and the "
                                  "order of the corners (row by row)"});
    else if (!strange.corners.empty())
      out.push_back(
          {"outlier_point", name + "a corner far off the others of its view: sample " +
                                listed(strange.corners, kNamedViews) +
                                ". Take these corners out of the samples, and calibrate again"});
    if (numbering.empty() && !strange.views.empty())
      out.push_back({"outlier_view",
                     name + "corners of sample " + listed(strange.views, kNamedViews) +
                         " are not in the order of board '" + target.name +
                         "', or not its corners: look at these pictures, take the views out of the "
                         "samples, and calibrate again"});
  }
  return out;
}

std::vector<IntrinsicsNote> copied_views(const Rig& rig, const std::vector<Sample>& samples,
                                         int sensor) {
  std::map<std::pair<int, std::vector<double>>, std::string> first;  // target, pixels: its sample
  std::vector<std::string> copies;
  for (const Sample& sample : samples)
    for (const View& view : sample.views) {
      if (view.sensor != sensor) continue;
      const auto seen = first.emplace(std::make_pair(view.target, view.z), sample.id);
      if (!seen.second)
        copies.push_back(quoted(sample.id) + " (as " + quoted(seen.first->second) + ")");
    }
  if (copies.empty()) return {};
  return {{"copied",
           "'" + rig.sensors[sensor].name +
               "': views that are the same as another one to the last digit: sample " +
               listed(copies, kNamedViews) +
               ". A copy adds no information but counts as data, so that sigmas are too small: "
               "remove copies from the samples"}};
}

IntrinsicsNote bent_boards(double flat, double bent, double most) {
  return {
      "bent",
      text("boards look bent, by up to %.2g mm: what was held out is off by %.3g px, and by %.3g "
           "px with boards that may be bent. Glue the board to something flat and record again, "
           "or estimate the warp: --warp",
           most * 1e3, flat, bent)};
}

std::vector<IntrinsicsNote> apart(const std::vector<std::string>& cameras, double alone,
                                  double together) {
  if (!(together > kSpoiltNoise && together > kFarApart * alone)) return {};
  return {
      {"apart",
       text("the views of cameras %s do not belong together: each camera by itself leaves %.2g "
            "px, together they leave %.3g px. All views of a sample must be of one moment: check "
            "whether the pictures of one camera are in another order, or shifted",
            listed(cameras, cameras.size()).c_str(), alone, together),
       true}};
}

IntrinsicsNote another_lens(const AnotherLens& found) {
  const std::string which = text("'%s': %zu of %zu views (sample ", found.camera.c_str(),
                                 found.samples.size(), found.views) +
                            listed(found.samples, kNamedViews) + ")";
  if (found.turned)
    return {"turned",
            which + text(" are turned by 180 degrees against the others: one lens leaves %.3g px "
                         "of all, and %.3g px where these are turned back. Turn these pictures or "
                         "the others, whichever are upside down, detect again, and calibrate "
                         "again",
                         found.together, found.apart),
            true};
  return {"two_lenses",
          which + text(" are of another lens than the others: one lens leaves %.3g px of all, two "
                       "leave %.3g px. These are pictures of two cameras, or the lens was focused "
                       "or zoomed, or images were cropped or scaled in between: calibrate the "
                       "two parts separately",
                       found.together, found.apart),
          true};
}

double looseness(const ParameterEstimate& intrinsics, double noise, double counted) {
  double worst = 0;
  const double share = noise / counted * counted_share(noise);
  for (const double sigma : intrinsics.sigma) {
    if (!std::isfinite(sigma)) return kNan;
    worst = std::max(worst, share * sigma / std::abs(intrinsics.value[0]));
  }
  return worst;
}

bool has_far_corners(const Solution& solution, int sensor) {
  const FarCorners far = far_corners(solution, sensor);
  return !far.corners.empty() || !far.views.empty();
}

bool is_undetermined(const FittedLens& fit) {
  const ParameterEstimate& lens = intrinsics_of(fit);
  std::set<int> seen;
  for (const Sample& sample : fit.solution.samples())
    for (const View& view : sample.views)
      if (view.sensor == fit.sensor) seen.insert(view.target);
  const bool flat = std::all_of(seen.begin(), seen.end(),
                                [&](int t) { return fit.solution.rig().targets[t].grid; });
  return (fit.views < 2 && flat) ||
         !(looseness(lens, fit.noise, fit.noise) <= scales(ParameterKind::intrinsics, "px").open);
}

std::vector<IntrinsicsNote> lens_notes(const FittedLens& fit, bool mistaken) {
  std::vector<IntrinsicsNote> out;
  if (!mistaken) {
    note_undetermined(fit, out);
    note_far_corners(fit, out);
    note_mirrored(fit, out);
  }
  note_image_size(fit, out);
  return out;
}

bool is_unexplained(const FittedLens& fit, double stated, bool mistaken) {
  const double times = fit.noise / stated;
  return fit.noise > kSpoiltNoise && times * times > (mistaken ? kProvenChi2 : kFarChi2);
}

}  // namespace kincal
