# shellcheck shell=bash
# The parts of scripts/test --sanitize: sourced, never run. Everything lies in build/.sanitize, whose dot keeps roslaunch from
# finding launch files there too; what a sanitizer or valgrind reports is in findings/, a file for each process.
sanitize_dir=$build_dir/.sanitize
findings_dir=$sanitize_dir/findings
results_dir=$sanitize_dir/results

# Tests of what runs on threads of its own, without a ROS master: reports from ROS's own libraries, which are compiled
# without the sanitizer, would hide ours.
thread_tests=(imu_inbox_test worker_test inertial_window_test calibrators_test lidar_inertial_calibrator_test
  visual_inertial_failure_test fuser_failure_test calibrate_bag_test)
# Layers whose tests run under valgrind, some thirty times slower. Left out are the layers that simulate and calibrate
# whole drives, or draw pictures, which would take hours (calibrators, initialization, lidar, visual, sim, monitor), those
# that need ROS, and of these layers:
memcheck_layers=(geometry measurements sensors inertial factors estimation io)
memcheck_without=(persistence_test)  # kills programs of its own, again and again

# sanitized_package NAME FLAGS TARGET...: builds this package with the flags, as a package of its own that consists of
# links into this one: rosrun and roslaunch take every program below a package for its own.
sanitized_package() {
  local package="$sanitize_dir/$1" flags="$2" entry
  shift 2
  mkdir -p "$package"
  for entry in "$repo"/*; do
    case "${entry##*/}" in build* | output) ;; *) ln -sfn "$entry" "$package/${entry##*/}" ;; esac
  done
  if [ -e "$repo/../shared" ]; then ln -sfn "$(cd "$repo/../shared" && pwd)" "$sanitize_dir/shared"; fi
  repo=$package build_dir=$package/build
  # Without a build type assertions stay, ours and Eigen's. Eigen must not take malloc of its own where Debian's libraries do not.
  cmake_options=(-DCMAKE_BUILD_TYPE=None "-DCMAKE_CXX_FLAGS=$flags -fno-omit-frame-pointer -g1 -O1 -DEIGEN_MALLOC_ALREADY_ALIGNED=1")
  build "$@"
}

# Address and undefined behaviour: the tests, the nodelets in the stock manager, which must load the sanitizers first. They
# need ten times their time then: recordings are played to them at a tenth of their pace.
run_address_part() (
  say "address and undefined behaviour sanitizers: all tests"
  sanitized_package cocalib "-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all" all tests
  export ASAN_OPTIONS="detect_leaks=0:new_delete_type_mismatch=0:log_path=$findings_dir/address"
  export UBSAN_OPTIONS="print_stacktrace=1:log_path=$findings_dir/undefined"
  export COCALIB_LAUNCH_PREFIX="env LD_PRELOAD=$(g++ -print-file-name=libasan.so):$(g++ -print-file-name=libubsan.so)"
  export COCALIB_TEST_PACE=0.1
  run_tests
  collect_results address $?
)

run_thread_part() (
  say "thread sanitizer: the tests of what runs on threads"
  mapfile -t names < <(wanted "${thread_tests[@]}")
  sanitized_package threads "-fsanitize=thread" "${names[@]}"
  export TSAN_OPTIONS="second_deadlock_stack=1:suppressions=$repo/scripts/thread.supp:log_path=$findings_dir/thread"
  COCALIB_TESTS="_gtest_($(IFS='|'; echo "${names[*]}"))\$" run_tests
  collect_results thread $?
)

run_memcheck_part() (
  say "valgrind: the quick tests of the core"
  all=()
  for layer in "${memcheck_layers[@]}"; do
    for file in "$repo/test/$layer"/*_test.cpp; do [ ! -e "$file" ] || all+=("$(basename "$file" .cpp)"); done
  done
  mapfile -t names < <(wanted "${all[@]}" | grep -vxF "$(printf '%s\n' "${memcheck_without[@]}")")
  build "${names[@]}"
  cd "$repo" || exit
  status=0
  for name in "${names[@]}"; do
    begin=$SECONDS
    valgrind --quiet --error-exitcode=99 --leak-check=full --errors-for-leak-kinds=definite \
      --log-file="$findings_dir/memcheck.$name" "$build_dir/devel/lib/cocalib/$name" \
      --gtest_output="xml:$results_dir/memcheck/$name.xml" >"$sanitize_dir/memcheck.log" 2>&1 </dev/null ||
      { status=1; tail -n 40 "$sanitize_dir/memcheck.log"; }
    say "$name: $((SECONDS - begin)) s"
  done
  return $status
)

# wanted NAME...: those that COCALIB_TESTS asks for.
wanted() { printf '%s\n' "$@" | grep -E -- "${COCALIB_TESTS:-.}"; }

# collect_results PART STATUS: returns STATUS.
collect_results() {
  cp -r "$build_dir/test_results" "$results_dir/$1"
  return "$2"
}

# run_sanitizers PART...: the parts in turn, all of them if none is given. The last line counts the tests of all parts.
run_sanitizers() {
  local part status=0 file
  rm -rf "$findings_dir" "$results_dir"
  mkdir -p "$findings_dir" "$results_dir"
  [ $# -gt 0 ] || set -- address thread memcheck
  for part in "$@"; do "run_${part}_part" || status=1; done
  find "$findings_dir" -type f -empty -delete
  for file in "$findings_dir"/*; do
    [ -e "$file" ] || continue
    status=1
    say "reported in $file:"
    head -n 25 "$file"
  done
  exec python3 "$repo/scripts/summarize_tests.py" "$results_dir" --ctest-status "$status"
}
