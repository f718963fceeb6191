#include <algorithm>
#include <map>

#include "cocalib/geometry/so3.h"
#include "cocalib/inertial/motion_credit.h"
#include "cocalib/initialization/track_alignment.h"

namespace cocalib {
namespace {

constexpr std::size_t kFewestSights = 4;
constexpr std::size_t kMostSights = 10;  // of one track in one chunk; more add time, not information
constexpr std::size_t kMostTracksPerChunk = 40;
constexpr std::size_t kFewestTracksPerChunk = 8;
constexpr double kMinParallax_rad = 0.015;  // ten times a bearing's noise: its depth is not made of noise

/// Orientation at every chunk's start, by the gyro.
void chainOrientations(TrackProblem& problem) {
  problem.R_G_chunk = {Eigen::Quaterniond::Identity()};
  problem.R_G_chunk_bg = {Eigen::Matrix3d::Zero()};
  for (std::size_t c = 0; c + 1 < problem.chunks.size(); ++c) {
    const InertialIncrement whole = problem.chunks[c].path.at(problem.chunks[c + 1].path.start());
    problem.R_G_chunk.push_back((problem.R_G_chunk[c] * whole.R_0_t).normalized());
    problem.R_G_chunk_bg.push_back(whole.R_0_t.conjugate().toRotationMatrix() * problem.R_G_chunk_bg[c] + whole.R_bg);
  }
}

/// Evenly spaced choice of at most kMostSights, first and last included.
std::vector<TrackSight> thinned(const std::vector<TrackSight>& sights) {
  if (sights.size() <= kMostSights) return sights;
  std::vector<TrackSight> result;
  for (std::size_t k = 0; k < kMostSights; ++k) result.push_back(sights[k * (sights.size() - 1) / (kMostSights - 1)]);
  return result;
}

/// Largest angle between two sights when the camera's rotation is taken out.
double parallax(const TrackProblem& problem, const std::vector<TrackSight>& sights) {
  double smallest_cosine = 1.0;
  for (const TrackSight& a : sights) {
    for (const TrackSight& b : sights) {
      const Eigen::Vector3d d_a = problem.R_G_C(a.frame) * a.bearing_C;
      smallest_cosine = std::min(smallest_cosine, d_a.dot(problem.R_G_C(b.frame) * b.bearing_C));
    }
  }
  return std::acos(std::clamp(smallest_cosine, -1.0, 1.0));
}

/// The longest tracks of one chunk that show parallax.
std::vector<ChunkTrack> tracksOfChunk(const TrackProblem& problem, std::size_t c,
                                      const std::vector<BearingFrame>& frames) {
  std::map<std::uint32_t, std::vector<TrackSight>> by_id;
  for (std::size_t f = problem.chunks[c].begin; f < problem.chunks[c].end; ++f) {
    for (std::size_t k = 0; k < std::min(frames[f].ids.size(), frames[f].bearings_C.size()); ++k) {
      const Eigen::Vector3d& bearing = frames[f].bearings_C[k];
      if (!bearing.allFinite() || bearing.norm() < 0.5) continue;
      by_id[frames[f].ids[k]].push_back({f, bearing.normalized()});
    }
  }
  std::vector<std::vector<TrackSight>> candidates;
  for (auto& [id, sights] : by_id) {
    if (sights.size() >= kFewestSights) candidates.push_back(std::move(sights));
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  std::vector<ChunkTrack> tracks;
  for (const std::vector<TrackSight>& sights : candidates) {
    if (tracks.size() == kMostTracksPerChunk) break;
    ChunkTrack track{c, thinned(sights), Eigen::Vector3d::Zero()};
    if (parallax(problem, track.sights) >= kMinParallax_rad) tracks.push_back(std::move(track));
  }
  return tracks;
}

}  // namespace

std::optional<TrackProblem> makeTrackProblem(const ImuBuffer& imu, const RotationInitialization& rotation,
                                             const std::vector<BearingFrame>& frames, double chunk_s,
                                             std::string& reason) {
  std::vector<TimeNs> stamps;
  for (const BearingFrame& frame : frames) stamps.push_back(frame.stamp + toNs(rotation.time_offset_s));
  TrackProblem problem;
  problem.R_imu_camera = rotation.R_imu_sensor;
  problem.gyro_bias = rotation.gyro_bias;
  problem.time_offset_s = rotation.time_offset_s;
  problem.chunks = splitIntoChunks(imu, stamps, chunk_s, rotation.gyro_bias, Eigen::Vector3d::Zero());
  constexpr std::size_t kUncoveredFrames = 10;  // at either end, that have not met their inertial samples
  bool covered = !problem.chunks.empty() && problem.chunks.front().begin <= kUncoveredFrames &&
                 problem.chunks.back().end + kUncoveredFrames >= frames.size();
  for (std::size_t c = 0; covered && c + 1 < problem.chunks.size(); ++c) covered = problem.chunks[c].continues_in_next;
  if (!covered) {
    reason = "the imu does not cover the pictures without a gap: check its rate, and the clocks of both";
    return std::nullopt;
  }
  // A lever arm of no known length would draw the whole scene to a point, and take the rotation along.
  if (!shiftShows(imu, stamps[problem.chunks.front().begin], stamps[problem.chunks.back().end - 1],
                  problem.gyro_bias)) {
    reason = "the scale does not show while the rig only turns: shift the camera too, speeding up and slowing down";
    return std::nullopt;
  }
  chainOrientations(problem);
  for (const TimeNs stamp : stamps) {
    std::size_t c = 0;
    while (c + 1 < problem.chunks.size() && problem.chunks[c + 1].path.start() <= stamp) ++c;
    problem.chunk_of_frame.push_back(c);
    problem.increments.push_back(problem.chunks[c].path.at(stamp));
  }
  for (std::size_t c = 0; c < problem.chunks.size(); ++c) {
    std::vector<ChunkTrack> tracks = tracksOfChunk(problem, c, frames);
    problem.tracks.insert(problem.tracks.end(), tracks.begin(), tracks.end());
  }
  if (problem.tracks.size() < kFewestTracksPerChunk * problem.chunks.size()) {
    reason =
        "too few features show parallax: shift the camera, not only turn it, with structure nearer than 5 m in view";
    return std::nullopt;
  }
  return problem;
}

}  // namespace cocalib
