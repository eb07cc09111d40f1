#include "boxes.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>

#include "../document/error.h"
#include "../document/files.h"
#include "xml.h"

namespace kincal {
namespace {

constexpr size_t kStlHead = 84, kStlTriangle = 50;  // bytes of a binary STL

/// The corners of all triangles, as an STL file has them; nothing: it is none.
std::optional<Eigen::AlignedBox3d> stl_extent(const std::string& text) {
  Eigen::AlignedBox3d out;
  std::uint32_t count = 0;
  if (text.size() >= kStlHead) std::memcpy(&count, text.data() + kStlHead - 4, 4);
  if (text.size() >= kStlHead && text.size() == kStlHead + kStlTriangle * size_t{count}) {
    for (size_t i = 0; i < 3 * size_t{count}; ++i) {  // a triangle: normal, three corners, 2 bytes
      float corner[3];
      std::memcpy(corner, text.data() + kStlHead + kStlTriangle * (i / 3) + 12 * (1 + i % 3), 12);
      const Vector3d point(corner[0], corner[1], corner[2]);
      if (!point.allFinite()) return std::nullopt;
      out.extend(point);
    }
  } else {
    const auto word = [&](size_t& at) {  // the next one, its end in `at`
      while (at < text.size() && is_blank(text[at])) ++at;
      const size_t begin = at;
      while (at < text.size() && !is_blank(text[at])) ++at;
      return begin;
    };
    for (size_t at = text.find("vertex"); at != std::string::npos; at = text.find("vertex", at)) {
      Vector3d corner;
      at += 6;
      for (double& v : corner) {
        const size_t begin = word(at);
        if (!to_number(text.data() + begin, text.data() + at, v)) return std::nullopt;
      }
      out.extend(corner);
    }
  }
  return out.isEmpty() ? std::nullopt : std::optional(out);
}

/// The file that a mesh names by a path, from the folder of its URDF; "": none is there.
std::string mesh_path(std::string name, const std::string& urdf_path) {
  if (name.rfind("file://", 0) == 0)
    name.erase(0, 7);
  else if (name.find("://") != std::string::npos)
    return "";  // package:// and the like: only ROS knows where
  const std::filesystem::path path = std::filesystem::path(urdf_path).parent_path() / name;
  const std::string end = path.extension().string();
  return (end == ".stl" || end == ".STL") && file_exists(path.string()) ? path.string() : "";
}

/// The box around a <geometry>, in its own axes.
std::optional<Eigen::AlignedBox3d> extent_of(const Xml& xml, const pugi::xml_node& geometry) {
  const auto around = [](const Vector3d& size) { return Eigen::AlignedBox3d(-size / 2, size / 2); };
  if (const pugi::xml_node box = geometry.child("box"))
    return around(vector3(xml, box, "size", Vector3d::Zero()));
  if (const pugi::xml_node cylinder = geometry.child("cylinder")) {
    const double width = 2 * number(xml, cylinder, "radius", 0);
    return around({width, width, number(xml, cylinder, "length", 0)});
  }
  if (const pugi::xml_node sphere = geometry.child("sphere"))
    return around(Vector3d::Constant(2 * number(xml, sphere, "radius", 0)));
  const pugi::xml_node mesh = geometry.child("mesh");
  const std::string path = mesh_path(mesh.attribute("filename").value(), xml.path);
  if (path.empty()) return std::nullopt;
  const auto extent = stl_extent(read_file(path));
  if (!extent) return std::nullopt;
  const Vector3d scale = vector3(xml, mesh, "scale", Vector3d::Ones());
  Eigen::AlignedBox3d out;  // a scale may be negative
  out.extend(extent->min().cwiseProduct(scale).eval());
  out.extend(extent->max().cwiseProduct(scale).eval());
  return out;
}

void add_box(const Xml& xml, const pugi::xml_node& shape, std::vector<LinkBox>& out) {
  const pugi::xml_node origin = shape.child("origin");
  try {
    const std::optional<Eigen::AlignedBox3d> extent = extent_of(xml, shape.child("geometry"));
    if (!extent || extent->sizes().minCoeff() < 0 || extent->sizes().maxCoeff() == 0) return;
    Pose pose;
    pose.rotation = rotation_from_rpy(vector3(xml, origin, "rpy", Vector3d::Zero()));
    pose.translation =
        vector3(xml, origin, "xyz", Vector3d::Zero()) + pose.rotation * extent->center();
    out.push_back({pose, extent->sizes()});
  } catch (const InputError&) {  // a number or file that cannot be read: no box
  }
}

}  // namespace

LinkBoxes link_boxes(const Urdf& urdf) {
  LinkBoxes out;
  out.of.resize(urdf.tree.links.size());
  const Xml xml{urdf.text, urdf.path, nullptr};
  const Elements links = children(urdf.document->document_element(), "link");
  for (size_t i = 0; i < links.size() && i < out.of.size(); ++i) {
    for (const char* kind : {"visual", "collision"})
      if (out.of[i].empty())
        for (const pugi::xml_node& shape : links[i].children(kind)) add_box(xml, shape, out.of[i]);
    if (!out.of[i].empty()) continue;
    const auto has_mesh = [](const pugi::xml_node& shape) {
      return !shape.child("geometry").child("mesh").empty();
    };
    const auto shapes = links[i].children();
    if (std::any_of(shapes.begin(), shapes.end(), has_mesh)) ++out.left_out;
  }
  return out;
}

}  // namespace kincal
