// Faults of pictures, camera_info and board, one by one (docs/reliability.md): see imu_faults_test.cpp.

#include <algorithm>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "fault_table.h"

namespace cocalib::test {
namespace {

using Event = Recording::Event;
constexpr auto kPicture = Recording::Kind::kPicture;
constexpr auto kInfo = Recording::Kind::kInfo;

/// Strikes every nth picture of the fault's time.
std::function<void(Recording*)> each(int nth, const std::function<void(Picture*)>& strike) {
  return [nth, strike](Recording* r) {
    r->change(kPicture, kFrom, kTo, [&](Event* e, int number) {
      if (number % nth == 0) strike(&e->picture);
      return true;
    });
  };
}

/// Before `to_s` only so many of three come.
std::function<void(Recording*)> lose(double to_s, int part) {
  return [to_s, part](Recording* r) {
    r->change(kPicture, kFrom, to_s, [part](Event*, int number) { return number % 3 >= part; });
  };
}

/// A picture with some texture, as a message.
sensor_msgs::Image message(const cv::Mat& gray, TimeNs stamp) {
  sensor_msgs::Image msg;
  msg.header.stamp = toRosTime(stamp);
  msg.header.frame_id = "camera_optical_frame";
  msg.encoding = "mono8";
  msg.width = msg.step = static_cast<std::uint32_t>(gray.cols);
  msg.height = static_cast<std::uint32_t>(gray.rows);
  msg.data.assign(gray.datastart, gray.dataend);
  return msg;
}
cv::Mat texture(int width = 752, int height = 480) {
  cv::Mat gray(height, width, CV_8UC1);
  cv::theRNG().state = 1;
  cv::randu(gray, 0, 255);
  cv::GaussianBlur(gray, gray, cv::Size(), 3.0);
  return gray;
}

/// Every nth picture comes as a message, struck.
std::function<void(Recording*)> eachMessage(int nth, const std::function<void(sensor_msgs::Image*)>& strike) {
  return each(nth, [strike](Picture* picture) {
    picture->raw = message(texture(), picture->seen.stamp);
    strike(&*picture->raw);
  });
}
std::function<void(Recording*)> stampsOff(int nth, double by_s) {
  return eachMessage(nth, [by_s](sensor_msgs::Image* msg) {
    msg->header.stamp = toRosTime(toTimeNs(msg->header.stamp) + toNs(by_s));
  });
}
/// All pictures look the same for a while.
std::function<void(Recording*)> show(const cv::Mat& gray) {
  return each(1, [gray](Picture* picture) { picture->raw = message(gray, picture->seen.stamp); });
}

/// Every second picture comes compressed, with its bytes struck.
std::function<void(Recording*)> eachCompressed(const char* format,
                                               const std::function<void(std::vector<std::uint8_t>*)>& strike) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(std::string(".") + format, texture(), bytes);
  strike(&bytes);
  return each(2, [bytes, format](Picture* picture) {
    sensor_msgs::CompressedImage msg;
    msg.header.stamp = toRosTime(picture->seen.stamp);
    msg.format = format;
    msg.data = bytes;
    picture->compressed = msg;
  });
}
void scramble(std::vector<std::uint8_t>* bytes) {
  for (std::size_t i = bytes->size() / 2; i < bytes->size() / 2 + 200; ++i) (*bytes)[i] ^= 0x5A;
}
void cutInHalf(std::vector<std::uint8_t>* bytes) { bytes->resize(bytes->size() / 2); }

/// A board of so many inner corners, upright in front of the camera.
cv::Mat drawBoard(int cols, int rows) {
  constexpr int kSquare = 40;
  cv::Mat gray(480, 752, CV_8UC1, cv::Scalar(230));
  for (int row = 0; row <= rows; ++row) {
    for (int col = 0; col <= cols; ++col) {
      const cv::Rect square(200 + col * kSquare, 80 + row * kSquare, kSquare, kSquare);
      if ((row + col) % 2 == 0) cv::rectangle(gray, square, cv::Scalar(20), cv::FILLED);
    }
  }
  cv::GaussianBlur(gray, gray, cv::Size(), 0.8);
  return gray;
}

/// A quarter of the features belongs to something that moves by itself, at 40 pixels per second.
void moveAnObject(Recording* r) {
  r->change(kPicture, kFrom, kTo, [](Event* e, int) {
    for (TrackObservation& track : e->picture.seen.tracks) {
      if (track.id % 4 == 0) track.px.x() += static_cast<float>(40.0 * (e->received_s - kFrom));
    }
    return true;
  });
}

/// Every second view of the board is that of another one, a metre and a half beside it.
void seeTwoBoards(Recording* r) {
  sim::Scenario other = r->scenario;
  other.board.distance_m = 2.2;
  other.board.tilt_rpy = {-0.3, -0.2, 0.1};
  const sim::Scene scene(other);
  const sim::Trajectory trajectory(other);
  r->change(kPicture, kFrom, kTo, [&](Event* e, int number) {
    const int k = static_cast<int>(std::lround(toSeconds(e->picture.seen.stamp - other.epoch) * other.camera.rate_hz));
    if (number % 2 == 0) e->picture.seen.board = sim::simulateBoard(other, scene, trajectory, k);
    return true;
  });
}

std::function<void(Recording*)> drift(double rate) {
  return [rate](Recording* r) {
    r->change(kPicture, 0.0, r->scenario.duration_s, [&](Event* e, int) {
      TimeNs& stamp = e->picture.seen.stamp;
      stamp += toNs(rate * toSeconds(stamp - r->scenario.epoch));
      return true;
    });
  };
}

/// For four seconds only a broken camera_info, then the right one.
std::function<void(Recording*)> infoAtFirst(const std::function<void(sensor_msgs::CameraInfo*)>& strike) {
  return [strike](Recording* r) {
    const auto first = std::find_if(r->events.begin(), r->events.end(), [](const Event& e) { return e.kind == kInfo; });
    Event right = *first;
    strike(&first->info);
    right.received_s = 4.0;
    r->events.insert(
        std::find_if(r->events.begin(), r->events.end(), [](const Event& e) { return e.received_s >= 4.0; }), right);
  };
}
/// One more comes, of a camera that has zoomed.
void zoom(Recording* r) {
  const auto at = [r](auto&& is) { return std::find_if(r->events.begin(), r->events.end(), is); };
  Event zoomed = *at([](const Event& e) { return e.kind == kInfo; });
  zoomed.received_s = kFrom;
  for (std::size_t i : {0, 4}) zoomed.info.K[i] *= 1.1;
  r->events.insert(at([](const Event& e) { return e.received_s >= kFrom; }), zoomed);
}
/// From the begin to the end.
void halveInfo(Recording* r) {
  r->change(kInfo, -1.0, 1.0, [](Event* e, int) {
    e->info.width /= 2;
    e->info.height /= 2;
    for (std::size_t i : {0, 2, 4, 5}) e->info.K[i] /= 2.0;
    return true;
  });
  r->change(kPicture, 0.0, r->scenario.duration_s, [](Event* e, int number) {
    if (number % 2 == 0) e->picture.raw = message(texture(), e->picture.seen.stamp);
    return number % 2 == 0;
  });
}

std::vector<Row> streamRows() {
  const std::string order = "images out of order";
  return {
      {"every third lost", false, "", kAtOnce_s, Fate::kAsGood, lose(kTo, 1)},
      {"repeated", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->repeat(kPicture, 2); }},
      {"received late", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->delay(kPicture, 10, 0.12); }},
      {"stamps back by 0.5 s", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(10, -0.5)},
      {"stamps ahead by an hour", false, "seconds away", kAtOnce_s, Fate::kAsGood, stampsOff(10, 3600.0)},
      {"stamps back by an hour", false, "seconds away", kAtOnce_s, Fate::kAsGood, stampsOff(10, -3600.0)},
      {"stamps ahead by 3 s", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(10, 3.0)},
      {"clock 20 ppm fast", false, "differ in camera clock offset", kAtOnce_s, Fate::kHonest, drift(2e-5)},
      {"gone for 7 s", false, "no pictures for longer than the window", kNewStart_s, Fate::kHonest, lose(15.0, 3),
       15.0},
  };
}

std::vector<Row> pictureRows() {
  using Image = sensor_msgs::Image;
  const std::string claims = "picture claims";
  return {
      {"lying height", false, claims, kAtOnce_s, Fate::kAsGood, eachMessage(2, [](Image* m) { m->height = 60'000; })},
      {"lying width", false, claims, kAtOnce_s, Fate::kAsGood, eachMessage(2, [](Image* m) { m->width = 1000; })},
      {"lying step", false, claims, kAtOnce_s, Fate::kAsGood, eachMessage(2, [](Image* m) { m->step = 0; })},
      {"cut short", false, claims, kAtOnce_s, Fate::kAsGood, eachMessage(2, [](Image* m) { m->data.resize(10'000); })},
      {"unknown encoding", false, "encoding", kAtOnce_s, Fate::kAsGood,
       eachMessage(2, [](Image* m) { m->encoding = "mono9"; })},
      {"another size", false, "the camera model is for 752 x 480", kAtOnce_s, Fate::kAsGood,
       each(2, [](Picture* p) { p->raw = message(texture(640, 400), p->seen.stamp); })},
      {"png with broken bytes", true, "compressed picture", kAtOnce_s, Fate::kAsGood, eachCompressed("png", scramble)},
      {"png cut short", false, "compressed picture", kAtOnce_s, Fate::kAsGood, eachCompressed("png", cutInHalf)},
      {"jpeg cut short", false, "compressed picture is cut short", kAtOnce_s, Fate::kAsGood,
       eachCompressed("jpg", cutInHalf)},
      {"impossible pixels", false, "images with impossible numbers", kAtOnce_s, Fate::kAsGood,
       each(2, [](Picture* p) { p->seen.tracks[0].px.x() = std::numeric_limits<float>::quiet_NaN(); })},
      {"blackout", false, "too few features", kAtOnce_s, Fate::kHonest,
       show(cv::Mat(480, 752, CV_8UC1, cv::Scalar(0)))},
      {"overexposed", false, "too few features", kAtOnce_s, Fate::kHonest,
       show(cv::Mat(480, 752, CV_8UC1, cv::Scalar(255)))},
      {"something moves by itself", false, "", kAtOnce_s, Fate::kHonest, moveAnObject},
  };
}

std::vector<Row> infoAndBoardRows() {
  const auto zero = [](sensor_msgs::CameraInfo* info) { info->K.fill(0.0); };
  const auto no_focal_length = [](sensor_msgs::CameraInfo* info) { info->K[0] = info->K[4] = 0.0; };
  const auto no_size = [](sensor_msgs::CameraInfo* info) { info->width = info->height = 0; };
  return {
      {"camera_info zero for 4 s", true, "the camera is not calibrated", kNewStart_s, Fate::kHonest, infoAtFirst(zero),
       4.0},
      {"no focal length for 4 s", false, "camera_info", kNewStart_s, Fate::kHonest, infoAtFirst(no_focal_length), 4.0},
      {"camera_info without size", false, "is impossible", kNewStart_s, Fate::kHonest, infoAtFirst(no_size), 4.0},
      {"camera_info of half the size", false, "the camera model is for 376 x 240", kNever_s, Fate::kNone, halveInfo},
      {"camera_info that changes", true, "it has changed while running", kAtOnce_s, Fate::kAsGood, zoom},
      {"board half hidden", false, "", kAtOnce_s, Fate::kAsGood, each(1, [](Picture* p) { p->seen.board.reset(); })},
      {"two boards", false, "differ in camera", kAtOnce_s, Fate::kHonest, seeTwoBoards},
      {"squares a fifth smaller", false, "differ in camera", kAtOnce_s, Fate::kHonest, [](Recording*) {}, kTo, 0.08},
  };
}

const Faultless& faultless() {
  static const Faultless f(Recording::ofCamera());
  return f;
}

TEST(CameraFaults, OfTheStream) { expectSurvived(streamRows(), faultless()); }
TEST(CameraFaults, OfThePictures) { expectSurvived(pictureRows(), faultless()); }
TEST(CameraFaults, OfCameraInfoAndBoard) { expectSurvived(infoAndBoardRows(), faultless()); }

/// Nobody has seen the right board yet: afterwards there is nothing to ask.
TEST(CameraFaults, AnotherBoardIsNamed) {
  Recording recording = faultless().recording;
  recording.events.erase(std::find_if(recording.events.begin(), recording.events.end(),
                                      [](const Event& e) { return e.received_s >= 6.0; }),
                         recording.events.end());
  recording.change(kPicture, 0.0, 6.0, [](Event* e, int number) {
    if (number % 20 == 0) e->picture.raw = message(drawBoard(7, 5), e->picture.seen.stamp);
    e->picture.seen.board.reset();
    return true;
  });
  const Outcome outcome = FaultRun(recording).run();
  EXPECT_TRUE(outcome.finite);
  EXPECT_TRUE(
      outcome.said("the board in the pictures has 7 x 5 inner corners, not 8 x 6; correct target: cols and rows"));
}

}  // namespace
}  // namespace cocalib::test
