#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "cocalib/io/result_file.h"

namespace cocalib {
namespace {

[[noreturn]] void fail(const std::string& path, const std::string& what, int error) {
  throw std::runtime_error(path + ": cannot " + what + ": " + std::strerror(error));
}

std::string directoryOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

/// Temporary file that is gone again unless it is renamed.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& target) : target_(target) {
    const std::string pattern = target + ".XXXXXX";
    name_.assign(pattern.begin(), pattern.end());
    name_.push_back('\0');
    file_ = ::mkstemp(name_.data());
    if (file_ < 0) fail(target_, "create a file beside it", errno);
  }
  ~TemporaryFile() {
    if (file_ >= 0) ::close(file_);
    if (!renamed_) ::unlink(name_.data());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  void write(const std::string& text) {
    std::size_t done = 0;
    while (done < text.size()) {
      const ssize_t written = ::write(file_, text.data() + done, text.size() - done);
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) fail(target_, "write", written < 0 ? errno : ENOSPC);
      done += static_cast<std::size_t>(written);
    }
    const mode_t mask = ::umask(0);  // mkstemp gives 0600; others may read a result as any file of the user's
    ::umask(mask);
    if (::fchmod(file_, 0666 & ~mask) != 0) fail(target_, "set permissions", errno);
    if (::fsync(file_) != 0) fail(target_, "write to disk", errno);
  }

  void moveToTarget() {
    const int file = file_;
    file_ = -1;
    if (::close(file) != 0) fail(target_, "write to disk", errno);  // network file systems report a full disk here
    if (::rename(name_.data(), target_.c_str()) != 0) fail(target_, "replace", errno);
    renamed_ = true;
  }

 private:
  std::string target_;
  std::vector<char> name_;
  int file_ = -1;
  bool renamed_ = false;
};

}  // namespace

void writeFileAtomically(const std::string& path, const std::string& text) {
  TemporaryFile file(path);
  file.write(text);
  file.moveToTarget();

  // The new name is safe from a power cut only when the directory is on the disk too. File systems that cannot sync a
  // directory (EINVAL) have done what they can.
  const int directory = ::open(directoryOf(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0) return;  // writable but not readable: the file itself is complete
  const int error = ::fsync(directory) != 0 ? errno : 0;
  ::close(directory);
  if (error == EIO) fail(path, "write its directory to disk", error);
}

}  // namespace cocalib
