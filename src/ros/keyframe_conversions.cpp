#include "cocalib/ros/keyframe_conversions.h"

#include <algorithm>
#include <cstddef>

#include "cocalib/ros/conversions.h"

namespace cocalib {

ImuState toStateMsg(const NavState& state) {
  ImuState msg;
  msg.stamp = toRosTime(state.stamp);
  msg.T_world_imu = toPoseMsg(state.T_W_I);
  msg.velocity = toVectorMsg(state.v_W);
  msg.gyro_bias = toVectorMsg(state.gyro_bias);
  msg.accel_bias = toVectorMsg(state.accel_bias);
  return msg;
}

NavState fromStateMsg(const ImuState& msg) {
  NavState state;
  state.stamp = toTimeNs(msg.stamp);
  state.T_W_I = fromPoseMsg(msg.T_world_imu);
  state.v_W = fromVectorMsg(msg.velocity);
  state.gyro_bias = fromVectorMsg(msg.gyro_bias);
  state.accel_bias = fromVectorMsg(msg.accel_bias);
  return state;
}

VisualKeyframeMsg toKeyframeMsg(const VisualKeyframe& keyframe, const std::string& camera_frame) {
  VisualKeyframeMsg msg;
  msg.header.stamp = toRosTime(keyframe.stamp);
  msg.header.frame_id = camera_frame;
  msg.track_ids.reserve(keyframe.tracks.size());
  msg.track_px.reserve(2 * keyframe.tracks.size());
  for (const TrackObservation& track : keyframe.tracks) {
    msg.track_ids.push_back(track.id);
    msg.track_px.insert(msg.track_px.end(), {track.px.x(), track.px.y()});
  }
  if (keyframe.board) {
    for (const Eigen::Vector2f& px : keyframe.board->corners_px) {
      msg.board_px.insert(msg.board_px.end(), {px.x(), px.y()});
    }
  }
  msg.has_state = keyframe.state.has_value();
  if (keyframe.state) msg.state = toStateMsg(*keyframe.state);
  return msg;
}

VisualKeyframe fromKeyframeMsg(const VisualKeyframeMsg& msg) {
  VisualKeyframe keyframe;
  keyframe.stamp = toTimeNs(msg.header.stamp);
  const std::size_t tracks = std::min(msg.track_ids.size(), msg.track_px.size() / 2);
  keyframe.tracks.resize(tracks);
  for (std::size_t i = 0; i < tracks; ++i) {
    keyframe.tracks[i].id = msg.track_ids[i];
    keyframe.tracks[i].px = {msg.track_px[2 * i], msg.track_px[2 * i + 1]};
  }
  if (!msg.board_px.empty()) {
    keyframe.board.emplace();
    for (std::size_t i = 0; i + 1 < msg.board_px.size(); i += 2) {
      keyframe.board->corners_px.emplace_back(msg.board_px[i], msg.board_px[i + 1]);
    }
  }
  if (msg.has_state) keyframe.state = fromStateMsg(msg.state);
  return keyframe;
}

LidarKeyframeMsg toKeyframeMsg(const LidarKeyframe& keyframe, const std::string& lidar_frame) {
  const std::size_t count = keyframe.scan.points.size();
  LidarKeyframeMsg msg;
  msg.header.stamp = toRosTime(keyframe.scan.stamp);
  msg.header.frame_id = lidar_frame;
  msg.xyz.resize(3 * count);
  msg.offset_s.resize(count);
  msg.ring.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const LidarPoint& point = keyframe.scan.points[i];
    for (int axis = 0; axis < 3; ++axis) msg.xyz[3 * i + axis] = point.p[axis];
    msg.offset_s[i] = point.offset_s;
    msg.ring[i] = point.ring;
  }
  msg.has_state = keyframe.state.has_value();
  if (keyframe.state) msg.state = toStateMsg(*keyframe.state);
  return msg;
}

LidarKeyframe fromKeyframeMsg(const LidarKeyframeMsg& msg) {
  LidarKeyframe keyframe;
  keyframe.scan.stamp = toTimeNs(msg.header.stamp);
  const std::size_t count = std::min({msg.xyz.size() / 3, msg.offset_s.size(), msg.ring.size()});
  keyframe.scan.points.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    LidarPoint& point = keyframe.scan.points[i];
    point.p = {msg.xyz[3 * i], msg.xyz[3 * i + 1], msg.xyz[3 * i + 2]};
    point.offset_s = msg.offset_s[i];
    point.ring = msg.ring[i];
  }
  if (msg.has_state) keyframe.state = fromStateMsg(msg.state);
  return keyframe;
}

}  // namespace cocalib
