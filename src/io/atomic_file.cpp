#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
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

constexpr char kTemporaryMark[] = ".cocalib-";

[[noreturn]] void fail(const std::string& path, const std::string& what, int error) {
  throw std::runtime_error(path + ": cannot " + what + ": " + std::strerror(error));
}

std::string directoryOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

/// Name of the temporary file of `target`, for mkstemp(); hidden, and like no name that a person gives.
std::string temporaryPattern(const std::string& target) {
  const std::size_t name = target.rfind('/') + 1;  // npos + 1 == 0
  return target.substr(0, name) + "." + target.substr(name) + kTemporaryMark + "XXXXXX";
}

bool isTemporary(const std::string& name) {
  const std::size_t length = std::strlen(kTemporaryMark) + 6;
  return name.size() > length + 1 && name.front() == '.' &&
         name.compare(name.size() - length, length - 6, kTemporaryMark) == 0;
}

/// The directory that is written to, open and locked against sweep() of others. A directory that may be written to but
/// not read cannot be opened: then there is nothing to sweep and nothing to sync.
class Directory {
 public:
  explicit Directory(const std::string& path) : path_(path) {
    file_ = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (file_ < 0) return;
    if (::flock(file_, LOCK_EX | LOCK_NB) == 0) sweep();  // nobody else is writing: what lies there is left over
    ::flock(file_, LOCK_SH);
  }
  ~Directory() {
    if (file_ >= 0) ::close(file_);
  }
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;

  /// A new name is safe from a power cut only when the directory is on the disk too. File systems that cannot sync a
  /// directory (EINVAL) have done what they can.
  void sync() const {
    if (file_ >= 0 && ::fsync(file_) != 0 && errno == EIO) fail(path_, "write the directory to disk", errno);
  }

 private:
  /// Removes what processes left that were killed while they wrote.
  void sweep() const {
    DIR* const entries = ::opendir(path_.c_str());
    if (entries == nullptr) return;
    while (const dirent* entry = ::readdir(entries)) {
      if (isTemporary(entry->d_name)) ::unlinkat(file_, entry->d_name, 0);
    }
    ::closedir(entries);
  }

  std::string path_;
  int file_ = -1;
};

/// Temporary file that is gone again unless it is renamed.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& target) : target_(target) {
    const std::string pattern = temporaryPattern(target);
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
  const Directory directory(directoryOf(path));
  TemporaryFile file(path);
  file.write(text);
  file.moveToTarget();
  directory.sync();
}

}  // namespace cocalib
