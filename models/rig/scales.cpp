#include "scales.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "numbers.h"

namespace kincal {
namespace {

/// A size in the number's own unit, or a share of its nominal value.
struct Size {
  double value;
  bool is_share;
  double of(double nominal) const { return is_share ? value * std::abs(nominal) : value; }
};

using Whole = unsigned long long;
using Decimal = long double;
constexpr Size plain(Decimal x, double divisor = 1) {
  return {static_cast<double>(x) / divisor, false};
}
constexpr Size percent(Decimal x) { return {static_cast<double>(x) / 100, true}; }
constexpr Size operator""_mm(Whole x) { return plain(x, 1000); }
constexpr Size operator""_mm(Decimal x) { return plain(x, 1000); }
constexpr Size operator""_ms(Whole x) { return plain(x, 1000); }
constexpr Size operator""_mrad(Decimal x) { return plain(x, 1000); }
constexpr Size operator""_cm(Whole x) { return plain(x, 100); }
constexpr Size operator""_mrad(Whole x) { return plain(x, 1000); }
constexpr Size operator""_deg(Whole x) { return {static_cast<double>(x) * kPi / 180, false}; }
constexpr Size operator""_pc(Whole x) { return percent(x); }
constexpr Size operator""_pc(Decimal x) { return percent(x); }
constexpr Size operator""_n(Whole x) { return plain(x); }
constexpr Size operator""_n(Decimal x) { return plain(x); }
constexpr Size no = {kInfinity, false};  // the kind has none

struct ScaleRow {
  ParameterKind kind;
  const char* unit;  // or the name of a component whose sizes differ from those of its unit
  Size width, usual, yardstick, loose, open, least, mistaken, reported, far;
};

using K = ParameterKind;

// joint_offset: zeros are set to some mrad in a factory, by a mark on the housing to 3 degrees.
// joint_scale: teeth are counted, so a ratio is right to 0.1 %; belts and hobby servos are not. 0.3
//   % off is another gear or encoder.
// backlash: gears of arms have an arc minute or two, worn ones and hobby servos ten times that.
// temperature: measured arms move by some urad/K a joint. ripple: gears of measured arms have 0.02
//   to 0.3 mrad. coupling: belts and bevels through a wrist are stated; the rest is some
//   percent.
// joint_origin: links are machined; 2.5 times their width is a number mistyped in the URDF.
// compliance: drives of arms yield by some urad/Nm. load: links weigh some kilograms, and reach
// some
//   decimetres. Their widths on the automatic path go by what they bend (automatic/bending.h).
// poses: mounts have no width, for everything else is measured from them: they are free. What
//   nobody measured was put where it looks right; by then 25 cm and 14 degrees are no guess.
// intrinsics: a data sheet has the focal length to some percent; 20 % off is another lens or
//   resolution. A lens known to 5 % maps nothing.
// distortion: many rigs have lenses without any, and k3 is large where k1 is not (width); restarts
//   with as much fold points over (usual). xi and alpha of fisheyes are known to that, too; a chip
//   stands straight to a degree (rad: tau). Calibrated lenses have tangential coefficients of 1e-4
//   to some 1e-3 (p1, p2).
// time_offset: clocks of one computer are right to milliseconds; a picture is stamped when it
//   arrives, exposure and transfer too late. line_time: chips read out 500 to 2,000 rows in 5 to
//   30 ms; data sheets state it to some percent.
// square, baseline: a ruler over some squares is right to 1 % (width); 3 % off, it was not
// measured. print: printers stretch paper by some tenths of a percent; none of 1,000 boards to
// scale
//   recordings was given one. points: markers on a body are measured with a caliper. range: depth
//   cameras and lidars are sold as right to half a percent and some millimetres; used ones are off
//   by more. own_number: nothing is known but the unit.
// clang-format off
constexpr ScaleRow kScaleRows[] = {
    // kind, unit; width, usual; yardstick, loose, open; least, mistaken, reported, far
    {K::joint_offset, "rad", 5_mrad, 50_mrad, 1_deg,  no,    no,     no,     no,   no,     0.25_n},
    {K::joint_offset, "m",   1_mm,   50_mm,   1_cm,   no,    no,     no,     no,   no,     25_cm},
    {K::joint_scale,  "",    0.1_pc, 1_pc,    1_pc,   no,    no,     0.3_pc, 0.3_pc, no, 25_pc},
    {K::joint_shape,  "rad", no,     no,      1_deg,  no,    no,     no,     no,   no,     0.25_n},
    {K::joint_shape,  "m",   no,     no,      1_cm,   no,    no,     no,     no,   no,     25_cm},
    {K::joint_shape,  "",    no,     no,      0.01_n, no,    no,     no,     no,   no,     no},
    {K::backlash,     "rad", 0.5_mrad, 2_mrad, 1_deg, no,    no,     no,     no,   no,     0.25_n},
    {K::backlash,     "m",   0.1_mm, 0.5_mm,  1_cm,   no,    no,     no,     no,   no,     25_cm},
    {K::temperature,  "rad/K", 1e-5_n, 5e-5_n, 1e-3_n, no,   no,     no,     no,   no,     no},
    {K::temperature,  "m/K", 1e-6_n, 5e-6_n,  1e-4_n, no,    no,     no,     no,   no,     no},
    {K::ripple,       "rad", 0.1_mrad, 0.3_mrad, 1_deg, no,  no,     no,     no,   no,     no},
    {K::coupling,     "",    0.01_n, 0.05_n,  0.01_n, no,    no,     no,     no,   no,     no},
    {K::joint_origin, "rad", 2_mrad, 5_deg,   1_deg,  3_deg, 30_deg, no,     no,   10_deg, 0.25_n},
    {K::joint_origin, "m",   1_mm,   5_cm,    1_cm,   3_cm,  30_cm,  2.5_mm, no,   10_cm,  25_cm},
    {K::compliance, "rad/Nm", no,    1e-5_n,  1e-5_n, no,    no,     no,     no,   no,     no},
    {K::load,         "kg m", no,    0.5_n,   0.5_n,  no,    no,     no,     no,   no,     no},
    {K::sensor_pose,  "rad", no,     5_deg,   1_deg,  3_deg, 30_deg, no,     no,   10_deg, 0.25_n},
    {K::sensor_pose,  "m",   no,     5_cm,    1_cm,   3_cm,  30_cm,  no,     no,   10_cm,  25_cm},
    {K::target_pose,  "rad", no,     5_deg,   1_deg,  3_deg, 30_deg, no,     no,   10_deg, 0.25_n},
    {K::target_pose,  "m",   no,     5_cm,    1_cm,   3_cm,  30_cm,  no,     no,   10_cm,  25_cm},
    {K::intrinsics,   "px",  2_pc,   3_pc,    1_pc,   5_pc,  5_pc,   4_pc,   5_pc, 20_pc,  25_pc},
    {K::distortion,   "",    0.5_n,  0.05_n,  0.1_n,  no,    no,     no,     no,   no,     no},
    {K::distortion,   "p1",  0.001_n, 0.005_n, 0.1_n, no,    no,     no,     no,   no,     no},
    {K::distortion,   "p2",  0.001_n, 0.005_n, 0.1_n, no,    no,     no,     no,   no,     no},
    {K::distortion,   "rad", 20_mrad, 10_mrad, 1_deg, no,    no,     no,     no,   no,     no},
    {K::baseline,     "m",   2_mm,   1_cm,    1_cm,   no,    no,     no,     3_pc, 1.5_pc, 25_pc},
    {K::range_scale,  "",    0.5_pc, 1_pc,    1_pc,   no,    no,     0.5_pc, no,   no,     25_pc},
    {K::range_offset, "m",   5_mm,   2_cm,    1_cm,   no,    no,     no,     no,   no,     25_cm},
    {K::own_number,   "rad", no,     50_mrad, 1_deg,  no,    no,     no,     no,   no,     0.25_n},
    {K::own_number,   "m",   no,     5_cm,    1_cm,   no,    no,     no,     no,   no,     25_cm},
    {K::own_number,   "px",  no,     0.05_n,  10_n,   no,    no,     no,     no,   no,     no},
    {K::own_number,   "",    no,     0.05_n,  0.01_n, no,    no,     no,     no,   no,     no},
    {K::time_offset,  "s",   10_ms,  20_ms,   10_ms,  no,    no,     no,     no,   no,     no},
    {K::line_time,    "s",   1e-5_n, 3e-5_n,  1e-5_n, no,    no,     no,     no,   no,     no},
    {K::square,       "m",   1_pc,   1_pc,    1_pc,   no,    no,     0.5_pc, 3_pc, 1.5_pc, 25_pc},
    {K::warp,         "m",   0.5_mm, 2_mm,    1_mm,   no,    no,     no,     no,   no,     no},
    {K::print,        "",    0.002_n, 0.01_n, 0.001_n, no,  no,     no,     no,   no,     no},
    {K::points,       "m",   1_mm,   1_cm,    1_cm,   no,    no,     no,     no,   1.5_pc, 25_cm},
};
// clang-format on
constexpr ScaleRow kNoScales = {K::own_number, "", no, no, no, no, no, no, no, no, no};

Scales scales_of(const ScaleRow& row, double nominal) {
  return {row.width.of(nominal),    row.usual.of(nominal),    row.yardstick.of(nominal),
          row.loose.of(nominal),    row.open.of(nominal),     row.least.of(nominal),
          row.mistaken.of(nominal), row.reported.of(nominal), row.far.of(nominal)};
}

/// The row of a kind and a unit or component; null: there is none.
const ScaleRow* find_row(ParameterKind kind, const std::string& unit) {
  const auto row =
      std::find_if(std::begin(kScaleRows), std::end(kScaleRows),
                   [&](const ScaleRow& r) { return r.kind == kind && r.unit == unit; });
  return row == std::end(kScaleRows) ? nullptr : &*row;
}

}  // namespace

Scales scales(ParameterKind kind, const std::string& unit, double nominal) {
  const ScaleRow* row = find_row(kind, unit);
  if (!row) row = find_row(kind, "");
  return scales_of(row ? *row : kNoScales, nominal);
}

Scales scales(const ParameterTable& table, const Component& component, const VectorXd& values) {
  const Parameter& p = table.all[component.parameter];
  const bool first = p.pose || p.kind == ParameterKind::intrinsics;  // (poses have no shares)
  const std::string& name = p.components[component.index];
  const bool own_row = !name.empty() && find_row(p.kind, name);
  Scales out = scales(p.kind, own_row ? name : p.units[component.index],
                      values(p.start + (first ? 0 : component.index)));
  if (p.kind == ParameterKind::joint_shape) {
    out.width = out.usual = p.usual_error;
    if (p.yardstick > 0) out.yardstick = p.yardstick;
  }
  return out;
}

}  // namespace kincal
