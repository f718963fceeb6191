#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "fault_run.h"

namespace cocalib::test {

constexpr double kFrom = 8.0, kTo = 11.0;  ///< the fault [s]; before it the calibration stands
// From the end of the fault to an estimate with newer data [s]: with the next solve, after a new start, or never.
constexpr double kAtOnce_s = 2.5, kNewStart_s = 12.0, kNever_s = std::numeric_limits<double>::infinity();

/// What the result is worth.
enum class Fate {
  kAsGood,  ///< within twice the error without the fault
  kHonest,  ///< that, or it says that it is not converged
  kNone,    ///< no result, and it says so
};

/// One row of the table in docs/reliability.md.
struct Row {
  std::string name;
  bool cheap;         ///< in every test run
  std::string cause;  ///< part of a line that the user reads; empty: nothing is said of it
  double within_s;    ///< longest recovery, see above
  Fate fate;
  std::function<void(Recording*)> strike;
  double end_s = kTo;        ///< of the fault
  double square_m = 0.10;    ///< side of the board's squares, as the rig file says
  double clock_set_s = 0.0;  ///< what is added to all stamps from then on
};

/// A recording, and what comes of it without faults; simulated and calibrated once.
struct Faultless {
  Recording recording;
  Outcome outcome;
  explicit Faultless(Recording r) : recording(std::move(r)), outcome(FaultRun(recording).run()) {}

  /// Twice the error, or, because this one recording may have been lucky, twice its own 1 sigma.
  bool asGood(const Outcome& struck) const {
    return struck.sensors.size() == outcome.sensors.size() &&
           std::equal(struck.sensors.begin(), struck.sensors.end(), outcome.sensors.begin(), isAsGood);
  }

 private:
  static bool isAsGood(const Outcome::Sensor& struck, const Outcome::Sensor& usual) {
    const auto within = [](double error, double without, double sigma) {
      return error <= 2.0 * std::max(without, sigma);
    };
    const Vector6d& sigma = usual.verdict.sigma;
    return struck.verdict.valid &&
           within(struck.error.head<3>().norm(), usual.error.head<3>().norm(), sigma.head<3>().norm()) &&
           within(struck.error.tail<3>().norm(), usual.error.tail<3>().norm(), sigma.tail<3>().norm()) &&
           within(std::abs(struck.offset_error_s), std::abs(usual.offset_error_s), usual.verdict.time_offset_sigma_s);
  }
};

inline void print(const std::string& name, const Outcome& o, double recovery_s) {
  for (const Outcome::Sensor& s : o.sensors) {
    std::printf("%-32s %-18s %6.2f mm %7.4f deg %7.4f ms, again after %.1f s\n", name.c_str(),
                toString(o.estimate.status), 1e3 * s.error.head<3>().norm(), 57.29578 * s.error.tail<3>().norm(),
                1e3 * std::abs(s.offset_error_s), recovery_s);
  }
}

inline void expectSurvivedBy(const Row& row, const Faultless& faultless) {
  SCOPED_TRACE(row.name);
  Recording recording = faultless.recording;
  row.strike(&recording);
  const Outcome outcome = FaultRun(recording, row.square_m).run();
  const double recovery_s = outcome.recovery_s(row.end_s, recording.scenario.epoch + toNs(row.clock_set_s));
  print(row.name, outcome, recovery_s);
  EXPECT_TRUE(outcome.finite);
  EXPECT_LE(recovery_s, row.within_s);
  const Status status = outcome.estimate.status;
  const bool as_good = faultless.asGood(outcome);
  switch (row.fate) {
    case Fate::kAsGood:
      EXPECT_TRUE(as_good);
      break;
    case Fate::kHonest:
      EXPECT_TRUE(as_good || status != Status::kConverged);
      break;
    case Fate::kNone:
      EXPECT_EQ(status, Status::kInsufficientData);
      break;
  }
  if (row.cause.empty() || outcome.said(row.cause)) return;
  ADD_FAILURE() << "nothing said of: " << row.cause;
  for (const std::string& line : outcome.lines) std::printf("    %s\n", line.c_str());
}

/// All rows if they are asked for (scripts/test --faults), otherwise the cheap ones.
inline void expectSurvived(const std::vector<Row>& rows, const Faultless& faultless) {
  print("no fault", faultless.outcome, 0.0);
  ASSERT_TRUE(faultless.outcome.finite);
  ASSERT_EQ(faultless.outcome.estimate.status, Status::kConverged) << faultless.outcome.estimate.message;
  for (const Outcome::Sensor& sensor : faultless.outcome.sensors) {
    ASSERT_LT(sensor.error.head<3>().norm(), 2e-3);
    ASSERT_LT(sensor.error.tail<3>().norm(), 1e-3);
  }
  const bool all = std::getenv("COCALIB_FAULTS") != nullptr;
  for (const Row& row : rows) {
    if (row.cheap || all) expectSurvivedBy(row, faultless);
  }
}

}  // namespace cocalib::test
