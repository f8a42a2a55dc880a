// Threads that are waited for where they go out of scope: std::jthread, which the C++ library of Apple's compiler lacks.
#pragma once

#include <thread>
#include <utility>
#include <vector>

namespace pieper {

class Workers {
 public:
  Workers() = default;
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  ~Workers() {
    for (std::thread& thread : threads_) thread.join();
  }

  template <class Work>
  void start(Work&& work) {
    threads_.emplace_back(std::forward<Work>(work));
  }

 private:
  std::vector<std::thread> threads_;
};

}  // namespace pieper
