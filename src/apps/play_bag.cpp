/// play_bag: plays the rig's topics of a recording to the nodelets of calibrate.launch. Unlike rosbag play it starts
/// only when all of them listen, so that nothing is lost, and when the recording ends it has them finish, has the
/// result written and ends itself.

#include <ros/ros.h>
#include <rosbag/player.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <exception>
#include <iostream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/bag_input.h"

namespace {

namespace options = boost::program_options;
constexpr int kInputError = 1, kUsageError = 2;
constexpr double kPauseS = 1.0;  // between two passes
// In the order in which the data flow; each answers with success once its nodelet listens.
const std::vector<std::string> kFlushServices = {"visual_inertial/flush", "lidar_inertial/flush", "flush"};

struct Arguments {
  std::string rig, bag;
  double rate = 1.0, start_s = 0.0;
  int passes = 1;
};

options::options_description describeOptions() {
  options::options_description all("usage: play_bag --rig RIG.yaml --bag FILE.bag [--rate R] [--start S] [--passes N]");
  all.add_options()("rig", options::value<std::string>()->required(), "what the robot carries")(
      "bag", options::value<std::string>()->required(), "the recording")(
      "rate", options::value<double>()->default_value(1.0), "times the speed of the recording")(
      "start", options::value<double>()->default_value(0.0), "seconds of the bag to skip")(
      "passes", options::value<int>()->default_value(1), "times it is played, with stamps that go on");
  return all;
}

/// @throws boost::program_options::error on wrong usage
Arguments parseArguments(int argc, char** argv) {
  options::variables_map values;
  options::store(options::command_line_parser(argc, argv).options(describeOptions()).positional({}).run(), values);
  options::notify(values);
  Arguments arguments = {values["rig"].as<std::string>(), values["bag"].as<std::string>(), values["rate"].as<double>(),
                         values["start"].as<double>(), values["passes"].as<int>()};
  if (arguments.passes < 1) throw options::error("--passes must be 1 or more");
  if (!(arguments.rate > 0.0)) throw options::error("--rate must be more than 0");
  if (!(arguments.start_s >= 0.0)) throw options::error("--start must be 0 or more seconds");
  return arguments;
}

/// Plays one bag to this namespace's nodelets.
class Player {
 public:
  Player(const Arguments& arguments, cocalib::BagInput* input) : arguments_(arguments), input_(*input) {
    clock_ = nh_.advertise<rosgraph_msgs::Clock>("/clock", 100);
    rosbag::View all(input_.bag(), rosbag::TopicQuery(input_.topics()));
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      if (publishers_.count(connection->topic) != 0) continue;
      constexpr std::uint32_t kQueue = 2000;
      ros::AdvertiseOptions advertise = rosbag::createAdvertiseOptions(connection, kQueue);
      advertise.latch = connection->datatype == "sensor_msgs/CameraInfo";
      publishers_[connection->topic] = nh_.advertise(advertise);
    }
  }

  /// @return false if the nodelets never came or ROS ended
  bool waitForListeners() {
    publishFirst("sensor_msgs/CameraInfo");  // the nodelets need it before they listen to anything else
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(60.0);
    while (ros::ok() && ros::WallTime::now() < end) {
      if (allListen()) return true;
      ros::WallDuration(0.05).sleep();
    }
    return false;
  }

  void play() {
    // Another pass cannot go on with the motion of the one before; after a pause nobody expects it to.
    const ros::Duration period = input_.end() - input_.begin() + ros::Duration(kPauseS);
    const ros::WallTime begin = ros::WallTime::now();
    ros::Time ticked;
    for (int pass = 0; pass < arguments_.passes; ++pass) {
      const ros::Duration shift = period * pass;
      for (const rosbag::MessageInstance& message : input_.view()) {
        if (!ros::ok()) return;
        const ros::Time now = message.getTime() + shift;
        ros::WallTime::sleepUntil(begin + ros::WallDuration((now - input_.begin()).toSec() / arguments_.rate));
        if (now != ticked) tick(ticked = now);
        publish(message, shift);
      }
    }
    for (const auto& [topic, count] : played_) std::cout << "played " << count << " messages on " << topic << "\n";
  }

  /// Has the nodelets work off what they hold, solve over everything and write. @return whether a result was written
  bool finish() {
    ros::WallDuration(1.0).sleep();  // the last messages are still on the wire
    std::string words;
    const auto asked = [this, &words](const std::string& service) { return call(service, &words); };
    if (!std::all_of(kFlushServices.begin(), kFlushServices.end(), asked) || !asked("stop") || !asked("save")) {
      std::cerr << "play_bag: " << words << "\n";
      return false;
    }
    std::cout << "result: " << words << std::endl;
    return true;
  }

 private:
  bool allListen() {
    std::string words;
    for (const std::string& service : kFlushServices) {
      if (!ros::service::exists(service, false) || !call(service, &words)) return false;
    }
    for (const auto& [topic, publisher] : publishers_) {
      if (publisher.getNumSubscribers() == 0 && !publisher.isLatched()) return false;
    }
    return true;
  }

  void publishFirst(const std::string& type) {
    rosbag::View view(input_.bag(), rosbag::TypeQuery(type));
    std::map<std::string, bool> published;
    for (const rosbag::MessageInstance& message : view) {
      if (publishers_.count(message.getTopic()) == 0 || std::exchange(published[message.getTopic()], true)) continue;
      publishers_[message.getTopic()].publish(message);
    }
  }

  void publish(const rosbag::MessageInstance& message, const ros::Duration& shift) {
    const ros::Publisher& publisher = publishers_.at(message.getTopic());
    ++played_[message.getTopic()];
    if (shift.isZero()) return publisher.publish(message);
    switch (input_.streamOf(message)) {
      case cocalib::BagInput::Stream::kImu:
        return publishShifted<sensor_msgs::Imu>(publisher, message, shift);
      case cocalib::BagInput::Stream::kImage:
        return publishShifted<sensor_msgs::Image>(publisher, message, shift);
      case cocalib::BagInput::Stream::kCompressedImage:
        return publishShifted<sensor_msgs::CompressedImage>(publisher, message, shift);
      case cocalib::BagInput::Stream::kCloud:
        return publishShifted<sensor_msgs::PointCloud2>(publisher, message, shift);
      case cocalib::BagInput::Stream::kCameraInfo:
        return publishShifted<sensor_msgs::CameraInfo>(publisher, message, shift);
    }
  }

  template <typename Message>
  static void publishShifted(const ros::Publisher& publisher, const rosbag::MessageInstance& message,
                             const ros::Duration& shift) {
    const boost::shared_ptr<Message> copy = message.instantiate<Message>();
    copy->header.stamp += shift;
    publisher.publish(copy);
  }

  void tick(const ros::Time& now) {
    rosgraph_msgs::Clock msg;
    msg.clock = now;
    clock_.publish(msg);
  }

  bool call(const std::string& service, std::string* words) {
    std_srvs::Trigger trigger;
    const bool answered = ros::service::call(service, trigger);
    *words = answered ? trigger.response.message : "no answer from " + service;
    return answered && trigger.response.success;
  }

  const Arguments arguments_;
  cocalib::BagInput& input_;
  ros::NodeHandle nh_;
  ros::Publisher clock_;
  std::map<std::string, ros::Publisher> publishers_;
  std::map<std::string, std::size_t> played_;  // by topic
};

int play(const Arguments& arguments) {
  const cocalib::RigConfig rig = cocalib::loadRigFile(arguments.rig);
  cocalib::BagInput input(arguments.bag, rig, arguments.start_s);
  ros::AsyncSpinner spinner(1);  // connections of subscribers
  spinner.start();
  Player player(arguments, &input);
  if (!player.waitForListeners()) {
    if (ros::ok()) std::cerr << "play_bag: the calibrators do not listen; see their error above\n";
    return kInputError;
  }
  player.play();
  return ros::ok() && player.finish() ? 0 : kInputError;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "play_bag");
  std::vector<std::string> own;  // without what roslaunch adds
  ros::removeROSArgs(argc, argv, own);
  std::vector<char*> pointers;
  for (std::string& argument : own) pointers.push_back(argument.data());
  Arguments arguments;
  try {
    arguments = parseArguments(static_cast<int>(pointers.size()), pointers.data());
  } catch (const options::error& error) {
    std::cerr << "play_bag: " << error.what() << "\n" << describeOptions();
    return kUsageError;
  }
  try {
    return play(arguments);
  } catch (const std::exception& error) {
    std::cerr << "play_bag: " << error.what() << "\n";
  }
  return kInputError;
}
