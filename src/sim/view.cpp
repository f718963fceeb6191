#include "cocalib/sim/view.h"

#include <algorithm>

namespace cocalib::sim {

std::vector<View> viewsFrom(const Scene& scene, const Pose& T_W_C) {
  constexpr double kEdgeOn_m = 1e-6;  // the camera lies in the plane
  const Eigen::Quaterniond q_C_W = T_W_C.q.conjugate();
  std::vector<View> views;
  for (std::size_t i = 0; i < scene.rectangles().size(); ++i) {
    const Rectangle& r = scene.rectangles()[i];
    const Eigen::Vector3d c = q_C_W * (r.center - T_W_C.t), n = q_C_W * r.normal, u = q_C_W * r.u, v = q_C_W * r.v;
    const double distance = n.dot(c);
    if (std::abs(distance) < kEdgeOn_m) continue;
    const Eigen::Vector3d N = n / distance, A = u - u.dot(c) * N, B = v - v.dot(c) * N;
    View view;
    view.A = A.cast<float>();
    view.B = B.cast<float>();
    view.N = N.cast<float>();
    view.sides[0] = (r.half_u * N - A).cast<float>();
    view.sides[1] = (r.half_u * N + A).cast<float>();
    view.sides[2] = (r.half_v * N - B).cast<float>();
    view.sides[3] = (r.half_v * N + B).cast<float>();
    view.index = static_cast<int>(i);
    views.push_back(view);
  }
  return views;
}

View::Footprint View::footprint(const Eigen::Vector2f& ray, const Eigen::Matrix2f& ray_step) const {
  // Beyond the edge of a rectangle seen at a grazing angle the depth may be anything: keep it positive.
  const float depth = 1.0F / std::max(affine(N, ray), 1e-3F);
  Footprint result;
  result.a = affine(A, ray) * depth;
  result.b = affine(B, ray) * depth;
  const Eigen::Vector2f da = A.head<2>() - result.a * N.head<2>(), db = B.head<2>() - result.b * N.head<2>();
  result.J << da.dot(ray_step.col(0)), da.dot(ray_step.col(1)), db.dot(ray_step.col(0)), db.dot(ray_step.col(1));
  result.J *= depth;
  return result;
}

TileContent contentOf(const Tile& tile, const std::vector<View>& views) {
  TileContent content;
  const View* cover = nullptr;  // the nearest of those that fill the tile
  for (const View& view : views) {
    if (tile.highest(view.N) <= 0.0F) continue;
    bool outside = false, fills = tile.lowest(view.N) > 0.0F;
    for (const Eigen::Vector3f& side : view.sides) {
      outside = outside || tile.highest(side) < 0.0F;
      fills = fills && tile.lowest(side) > 0.0F;
    }
    if (outside) continue;
    content.views.push_back(&view);
    if (fills && (cover == nullptr || tile.lowest(view.N - cover->N) > 0.0F)) cover = &view;
  }
  if (cover == nullptr) return content;
  // Inverse depth is affine in the ray, so "nearer at all corners of the box" is nearer everywhere in it.
  const auto hidden = [&](const View* view) { return view != cover && tile.lowest(cover->N - view->N) > 0.0F; };
  content.views.erase(std::remove_if(content.views.begin(), content.views.end(), hidden), content.views.end());
  content.covered = content.views.size() == 1;
  return content;
}

}  // namespace cocalib::sim
