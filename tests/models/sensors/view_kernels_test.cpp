// models/sensors/view_kernels.h: the packed inner loops against SensorModel::evaluate(), for every
// instruction set that this processor has.
//
// Proves, for pinhole, Brown-Conrady with 5 and 8 numbers and points, and for 1 to 20 and 48 points
// with random ids: residuals and every entry of L are those of evaluate(), whitened, in the
// kernels' order; own numbers wanted in part and in any order of columns, spacing wanted or not,
// points of a grid and plain ones; rows of no point are zero; nothing else is written, not even
// right behind the arrays; squares is the sum; residuals alone are the same to rounding; what is
// behind a camera or not a number is refused, in whatever place of whatever pack it stands. The
// same for a tilting laser, for joints that turn and slide, both directions, its own side wanted or
// not, with any whitening. Does not prove: that evaluate() is right
// (models/sensors/sensors_test.cpp), nor sets that this processor lacks.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>

#include "../../../models/sensors/sensors.h"
#include "../../../solver/kernels.h"
#include "../../fixtures/random.h"

namespace view_kernels_test {

using namespace kincal;
using namespace kincal::fixture;
using Eigen::VectorXd;

namespace {

constexpr double kGuard = 12345.678;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

struct Kind {
  const char* name;
  std::shared_ptr<const SensorModel> model;
  ViewKernel ViewKernels::*kernel;
  std::vector<double> own;
};

std::vector<Kind> kinds() {
  return {{"pinhole",
           make_camera(Lens::pinhole, 0),
           &ViewKernels::pinhole,
           {500, 510, 319.5, 239.5, 0.12}},
          {"brown_conrady5",
           make_camera(Lens::brown_conrady, 5),
           &ViewKernels::brown_conrady5,
           {600, 580, 330, 250, -0.21, 0.08, 0.002, -0.003, 0.01, -0.05}},
          {"brown_conrady8",
           make_camera(Lens::brown_conrady, 8),
           &ViewKernels::brown_conrady8,
           {450, 470, 300, 220, 0.11, -0.05, -0.002, 0.001, 0.02, 0.25, 0.06, 0.01, 0.03}},
          {"point", make_point(), &ViewKernels::point, {}}};
}

std::vector<int> counts() {
  std::vector<int> out;
  for (int n = 1; n <= 20; ++n) out.push_back(n);
  out.push_back(48);
  return out;
}

/// Numbers that begin one double behind a boundary of 16, so that no vector is aligned by chance.
class Unaligned {
 public:
  explicit Unaligned(size_t n, double value) : all_(n + 9, value), n_(n) {
    while ((reinterpret_cast<size_t>(all_.data() + skip_) / 8) % 8 != 1) ++skip_;
  }
  double* data() { return all_.data() + skip_; }
  const double* data() const { return all_.data() + skip_; }
  double& operator[](size_t i) { return data()[i]; }
  size_t size() const { return n_; }

 private:
  std::vector<double> all_;
  size_t n_, skip_ = 0;
};

/// One view as both sides want it.
struct Scene {
  int rows, numbers, count, stride;
  bool grid;
  double spacing;
  Pose pose;
  Eigen::Matrix3Xd layout, points;
  std::vector<int> ids;
  std::vector<double> z, own, weight;
  Unaligned packed_points, packed_z;
  Matrix3d row_by_row;

  Scene(const Kind& kind, int n, bool is_grid, Random& random)
      : rows(kind.model->rows()),
        numbers(kind.model->measurement_size()),
        count(n),
        stride(padded(n)),
        grid(is_grid),
        spacing(is_grid ? 0.037 : 1),
        own(kind.own),
        packed_points(3 * static_cast<size_t>(padded(n)), 0),
        packed_z(static_cast<size_t>(kind.model->measurement_size()) * padded(n), 0) {
    const int all = n + 7;
    layout.resize(3, all);
    for (int i = 0; i < all; ++i) layout.col(i) = random.vector(0.4) / spacing;
    points = spacing * layout;
    for (int i = 0; i < n; ++i) ids.push_back(static_cast<int>(random.uniform() * all));
    pose = {random.rotation(3),
            Vector3d(random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), random.uniform(1.2, 2))};
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < numbers; ++k)
        z.push_back(numbers == 2 ? random.uniform(0, 600) : random.uniform(-1, 1));
    for (int k = 0; k < rows; ++k) weight.push_back(random.uniform(0.5, 20));
    place();
  }
  void place() {
    for (int i = 0; i < stride; ++i) {
      const int at = std::min(i, count - 1);
      for (int c = 0; c < 3; ++c)
        packed_points[static_cast<size_t>(c) * stride + i] = layout(c, ids[at]);
      for (int k = 0; k < numbers; ++k)
        packed_z[static_cast<size_t>(k) * stride + i] = i < count ? z[i * numbers + k] : 0;
    }
    row_by_row = pose.rotation.transpose();
  }
  PointView view() const {
    return {packed_points.data(),    spacing,    row_by_row.data(),
            pose.translation.data(), own.data(), packed_z.data(),
            weight.data(),           count,      stride};
  }
  ViewInput input() const {
    ViewInput in;
    in.sensor_T_target = pose;
    in.parameters = own.empty() ? nullptr : own.data();
    in.points = &points;
    in.layout = grid ? &layout : nullptr;
    in.ids = ids.data();
    in.count = count;
    in.z = z.data();
    return in;
  }
};

}  // namespace

TEST_CASE("view kernels: the rows of evaluate(), whitened, and nothing else is touched") {
  int sets;
  const Kernels* const* all = all_kernels(sets);
  Random random(701);
  for (const Kind& kind : kinds())
    for (int set = 0; set < sets; ++set)
      for (const int count : counts())
        for (int variant = 0; variant < 8; ++variant) {
          const bool grid = variant & 1, square = grid && (variant & 2);
          const Scene s(kind, count, grid, random);
          const int own = static_cast<int>(s.own.size());
          INFO(kind.name << ", " << all[set]->name << ", " << count << " points, variant "
                         << variant);

          // By evaluate(), in its own order.
          Columns columns;
          columns.parameters = own ? 6 : -1;
          columns.square = square ? 6 + own : -1;
          columns.total = 7 + own;
          VectorXd r(count * s.rows);
          RowMatrix l = RowMatrix::Zero(r.size(), columns.total);
          Eigen::Ref<RowMatrix> l_ref(l);
          REQUIRE(kind.model->evaluate(s.input(), columns, r.data(), &l_ref));

          // Wanted columns stand anywhere behind the pose; what is between them is not the
          // kernel's.
          const int width = 6 + 2 * own + 3;
          std::vector<int> places;
          for (int i = 6; i < width; ++i) places.push_back(i);
          for (size_t i = places.size(); i > 1; --i)
            std::swap(places[i - 1], places[static_cast<size_t>(random.uniform() * i)]);
          std::vector<int> own_place(static_cast<size_t>(own) + 1, -1);
          for (int j = 0; j < own; ++j)
            own_place[j] = variant < 2 || random.uniform() < 0.6 ? places[j] : -1;
          if (variant >= 6) std::fill(own_place.begin(), own_place.end(), -1);
          const int square_place = square ? places[own] : -1;
          const int length = s.rows * s.stride, ld = length + 3;
          Unaligned to_r(length + 16, kGuard), to_l(static_cast<size_t>(ld) * width + 16, kGuard);
          double squares = kGuard;
          const ViewKernel kernel = view_kernels(set).*kind.kernel;
          REQUIRE(kernel(s.view(), {to_r.data(), to_l.data(), ld, own_place.data(), square_place},
                         squares));

          std::vector<int> source(width, -1);  // column of l
          for (int c = 0; c < 6; ++c) source[c] = c;
          for (int j = 0; j < own; ++j)
            if (own_place[j] >= 0) source[own_place[j]] = 6 + j;
          if (square) source[square_place] = columns.square;
          const double z_size = s.numbers == 2 ? 600 : 2;
          double sum = 0;
          bool zeros = true;
          for (int k = 0; k < s.rows; ++k)
            for (int i = 0; i < s.stride; ++i) {
              const int row = k * s.stride + i;
              if (i >= count) {
                zeros = zeros && to_r[row] == 0;
                for (int c = 0; c < width; ++c)
                  if (source[c] >= 0) zeros = zeros && to_l[row + static_cast<size_t>(c) * ld] == 0;
                continue;
              }
              const double e = s.weight[k] * r(i * s.rows + k);
              sum += to_r[row] * to_r[row];
              CHECK(std::abs(to_r[row] - e) <= 1e-12 * (std::abs(e) + s.weight[k] * z_size));
              const double pose_size =
                  s.weight[k] * l.row(i * s.rows + k).head(6).cwiseAbs().maxCoeff();
              for (int c = 0; c < width; ++c) {
                if (source[c] < 0) continue;
                const double expected = s.weight[k] * l(i * s.rows + k, source[c]),
                             got = to_l[row + static_cast<size_t>(c) * ld];
                const bool own_number = source[c] >= 6 && source[c] < 6 + own;
                const double size = own_number
                                        ? s.weight[k] * l.col(source[c]).cwiseAbs().maxCoeff()
                                        : pose_size * (square ? 1 / s.spacing : 1);
                if (!(std::abs(got - expected) <= 1e-12 * size)) {
                  INFO("row " << row << ", column " << source[c]);
                  CHECK(got == expected);
                }
              }
            }
          CHECK(zeros);
          CHECK(std::abs(squares - sum) <= 1e-12 * sum);
          bool untouched = true;
          for (int i = length; i < length + 16; ++i) untouched = untouched && to_r[i] == kGuard;
          for (int c = 0; c < width; ++c)
            for (int i = source[c] >= 0 ? length : 0; i < ld; ++i)
              untouched = untouched && to_l[i + static_cast<size_t>(c) * ld] == kGuard;
          for (int i = 0; i < 16; ++i)
            untouched = untouched && to_l[static_cast<size_t>(ld) * width + i] == kGuard;
          CHECK(untouched);

          // Residuals alone.
          Unaligned alone(length + 16, kGuard);
          double alone_squares = kGuard;
          REQUIRE(kernel(s.view(), {alone.data(), nullptr, 0, own_place.data(), square_place},
                         alone_squares));
          bool same = true;
          for (int i = 0; i < length; ++i)
            same =
                same && std::abs(alone[i] - to_r[i]) <= 1e-13 * (std::abs(to_r[i]) + 20 * z_size);
          for (int i = length; i < length + 16; ++i) same = same && alone[i] == kGuard;
          CHECK(same);
          CHECK(std::abs(alone_squares - squares) <= 1e-12 * squares);
        }
}

TEST_CASE("view kernels: a tilting laser's rows are those of evaluate(), whitened by roots") {
  int sets;
  all_kernels(sets);
  Random random(703);
  const Kind kind{"tilting_laser", make_tilting_laser(), &ViewKernels::tilting_laser, {}};
  for (int set = 0; set < sets; ++set)
    for (const int count : counts())
      for (int variant = 0; variant < 16; ++variant) {
        const bool sensor_side = variant & 1, square = variant & 2;
        INFO("set " << set << ", " << count << " points, variant " << variant);
        Scene s(kind, count, square, random);
        kind.model->compared(s.z.data(), count, s.stride, s.packed_z.data());
        Scan scan;
        scan.sensor_T_before = {random.rotation(3), random.vector(0.3)};
        scan.behind_T_target = s.pose;
        scan.axis = random.direction();
        scan.prismatic = variant & 4;
        scan.direction = variant & 8 ? 1 : -1;
        scan.model = linear_joint().get();
        const double own[2] = {0.13, 1.1};
        scan.own = own;

        Columns columns;
        if (sensor_side) {
          columns.sensor_side = 6;
          columns.joint = 12;
          columns.total = 14;
        }
        if (square) columns.square = columns.total++;
        const int width = columns.total, length = 3 * s.stride, ld = length + 3;
        ViewInput in = s.input();
        in.scan = &scan;
        VectorXd r(3 * count);
        RowMatrix l = RowMatrix::Zero(3 * count, width);
        Eigen::Ref<RowMatrix> l_ref(l);
        REQUIRE(kind.model->evaluate(in, columns, r.data(), &l_ref));

        Unaligned turns(5 * static_cast<size_t>(s.stride), 0),
            roots(9 * static_cast<size_t>(s.stride), 0);
        double expected_squares = 0;
        for (int i = 0; i < count; ++i) {
          const double reading = s.z[3 * i], q = scan.direction * scan.position(reading);
          turns[i] = scan.prismatic ? 1 : std::cos(q);
          turns[s.stride + i] = scan.prismatic ? 0 : std::sin(q);
          turns[2 * s.stride + i] = scan.prismatic ? q : 0;
          for (int n = 0; n < 2; ++n)
            turns[(3 + n) * s.stride + i] = scan.direction * scan.model->by_own(n, reading, own);
          Matrix3d root;
          for (int c = 0; c < 9; ++c)
            roots[c * s.stride + i] = root(c / 3, c % 3) = random.uniform(-2, 2);
          r.segment<3>(3 * i) = (root * r.segment<3>(3 * i)).eval();
          l.middleRows(3 * i, 3) = (root * l.middleRows(3 * i, 3)).eval();
          expected_squares += r.segment<3>(3 * i).squaredNorm();
        }
        const Matrix3d side = scan.sensor_T_before.rotation.transpose();
        const ScanView scan_view{side.data(),
                                 scan.sensor_T_before.translation.data(),
                                 scan.axis.data(),
                                 scan.prismatic,
                                 turns.data(),
                                 turns.data() + 3 * s.stride,
                                 2,
                                 roots.data()};
        PointView view = s.view();
        view.scan = &scan_view;
        Unaligned to_r(length + 16, kGuard), to_l(static_cast<size_t>(ld) * width + 16, kGuard);
        const ViewKernel kernel = view_kernels(set).tilting_laser;
        double squares = kGuard;
        REQUIRE(kernel(view,
                       {to_r.data(), to_l.data(), ld, nullptr, columns.square, columns.sensor_side,
                        columns.joint},
                       squares));
        CHECK(std::abs(squares - expected_squares) <= 1e-12 * expected_squares);
        double worst = 0;
        bool clean = true;
        for (int k = 0; k < 3; ++k)
          for (int i = 0; i < s.stride; ++i)
            for (int c = -1; c < width; ++c) {
              const int row = k * s.stride + i;
              const double got = c < 0 ? to_r[row] : to_l[row + static_cast<size_t>(c) * ld];
              if (i >= count)
                clean = clean && got == 0;
              else
                worst = std::max(worst, std::abs(got - (c < 0 ? r(3 * i + k) : l(3 * i + k, c))));
            }
        CHECK(worst < 1e-13 * (1 + l.cwiseAbs().maxCoeff() + r.cwiseAbs().maxCoeff()));
        for (int i = length; i < length + 16; ++i) clean = clean && to_r[i] == kGuard;
        for (int c = 0; c < width; ++c)
          for (int i = length; i < ld; ++i)
            clean = clean && to_l[i + static_cast<size_t>(c) * ld] == kGuard;
        CHECK(clean);

        Unaligned alone(length + 16, kGuard);
        REQUIRE(kernel(view, {alone.data(), nullptr, 0, nullptr, -1}, squares));
        double apart = 0;
        for (int i = 0; i < length; ++i) apart = std::max(apart, std::abs(alone[i] - to_r[i]));
        CHECK(apart <= 1e-13 * (1 + r.cwiseAbs().maxCoeff()));
        CHECK(alone[length] == kGuard);

        s.packed_z[s.stride] = kNaN;
        CHECK_FALSE(kernel(view, {alone.data(), nullptr, 0, nullptr, -1}, squares));
      }
}

TEST_CASE("view kernels: undefined wherever one point is") {
  int sets;
  all_kernels(sets);
  Random random(702);
  for (const Kind& kind : kinds())
    for (int set = 0; set < sets; ++set)
      for (const int count : counts())
        for (int bad = 0; bad < count; ++bad)
          for (int how = 0; how < 9; ++how) {
            const bool camera = kind.model->rows() == 2;
            Scene s(kind, count, how % 2, random);
            s.ids.resize(count);
            for (int i = 0; i < count; ++i) s.ids[i] = i;
            const auto stand = [&](double depth) {  // of the bad point, in the camera's frame
              s.layout.col(bad) = s.pose.rotation.transpose() *
                                  (Vector3d(0.1, 0.05, depth) - s.pose.translation) / s.spacing;
            };
            if (how == 0) stand(-0.5);
            if (how == 1) s.layout(0, bad) = kNaN;
            if (how == 2) s.layout(1, bad) = kNaN;
            if (how == 3) s.layout(2, bad) = kNaN;
            if (how == 5) stand(-1e-6);
            if (how == 6) s.layout.col(bad).setConstant(kNaN);
            if (how == 8) stand(-1e6);
            s.points = s.spacing * s.layout;
            s.place();
            if (how == 4) s.packed_z[static_cast<size_t>(s.numbers - 1) * s.stride + bad] = kNaN;
            if (how == 7) {  // exactly in the plane of the camera's centre
              s.row_by_row.setIdentity();
              s.pose = {Matrix3d::Identity(), Vector3d(0, 0, 0)};
              for (int i = 0; i < s.stride; ++i)
                s.packed_points[2 * static_cast<size_t>(s.stride) + i] = 1 / s.spacing;
              for (int i = bad; i < (bad == count - 1 ? s.stride : bad + 1); ++i)
                s.packed_points[2 * static_cast<size_t>(s.stride) + i] = 0;
            }
            const bool nothing_wrong_for_points = how == 0 || how == 5 || how == 7 || how == 8;
            INFO(kind.name << ", set " << set << ", " << count << " points, point " << bad
                           << ", way " << how);
            const int length = s.rows * s.stride, width = 6 + static_cast<int>(s.own.size()) + 1;
            std::vector<double> r(length), l(static_cast<size_t>(length) * width);
            std::vector<int> own(s.own.size() + 1);
            for (size_t j = 0; j < s.own.size(); ++j) own[j] = 6 + static_cast<int>(j);
            double squares;
            const ViewKernel kernel = view_kernels(set).*kind.kernel;
            const bool with =
                kernel(s.view(), {r.data(), l.data(), length, own.data(), width - 1}, squares);
            const bool without = kernel(s.view(), {r.data(), nullptr, 0, own.data(), -1}, squares);
            REQUIRE(with == (!camera && nothing_wrong_for_points));
            REQUIRE(without == with);
          }
}

TEST_CASE("view kernels: those in use are of the instruction set in use, and sensors have them") {
  const ViewKernels& used = view_kernels();
  const ViewKernels& chosen = view_kernels(instruction_set());
  for (const Kind& kind : kinds()) {
    INFO(kind.name);
    CHECK(used.*kind.kernel == chosen.*kind.kernel);
    CHECK(kind.model->kernel() == used.*kind.kernel);
  }
  CHECK(make_camera(Lens::kannala_brandt, 4)->kernel() == nullptr);
  CHECK(make_tilting_laser()->kernel() == used.tilting_laser);
}

}  // namespace view_kernels_test
