// Whether solving again allocates: a program of its own, whose malloc and its kin count (libraries'
// calls, Eigen's and operator new's end there). Without glibc, or with a sanitizer that brings its
// own malloc, it is not built.
//
// Proves: after the first solve() of a LevenbergMarquardt the second and third allocate nothing, in
// any thread: on a PR2-like robot and on the nasty one with every type of sensor, dense, in noise
// modes none and latent, with priors, with losses, with rejected steps, through the accelerated
// tail, with 1 and 2 threads; likewise bundle adjustment; Estimation::reload(); and a Calibration
// whose samples are replaced before it solves again. In marginal and point only renew() may. A
// monitor allocates nothing for samples of prepared forms, of mounted targets and of free ones that
// only cameras see, that fit or not; it takes the memory that monitor_memory() says, at most 5 %
// less. Does not prove: anything about CHOLMOD, or about the first call.
#include <cxxabi.h>
#include <dlfcn.h>
#include <execinfo.h>
#include <malloc.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <thread>

#include "../../benchmarks/pr2_like.h"
#include "../../models/bundle_adjustment/bundle_adjustment.h"
#include "../../models/calibration/calibration.h"
#include "../../models/estimation/estimation.h"
#include "../../models/monitor/monitor.h"
#include "../../models/rig/parameters.h"
#include "../../solver/levenberg_marquardt.h"
#include "../fixtures/problem.h"
#include "../fixtures/random.h"
#include "../fixtures/rigs.h"
#include "../fixtures/samples.h"
#include "../fixtures/transforms.h"
#include "../fixtures/two_joints.h"

using namespace kincal;
using namespace kincal::fixture;

// ---------------------------------------------------------------- counting

namespace {

std::atomic<long> counted{0};
std::atomic<bool> counting{false};
std::atomic<long> held{0};         // bytes, from when `counting` begins
thread_local bool inside = false;  // backtrace() may allocate

constexpr int kTraces = 2000, kDepth = 24;
void* traces[kTraces][kDepth];
int depths[kTraces];

void* note(void* p);
void note() {
  if (!counting.load(std::memory_order_relaxed) || inside) return;
  inside = true;
  const long at = counted++;
  if (at < kTraces) depths[at] = backtrace(traces[at], kDepth);
  inside = false;
}

void* note(void* p) {
  if (counting && p) held += static_cast<long>(malloc_usable_size(p));
  note();
  return p;
}

}  // namespace

extern "C" {
void __libc_free(void*);
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);

void* malloc(size_t n) { return note(__libc_malloc(n)); }
void* calloc(size_t n, size_t size) { return note(__libc_calloc(n, size)); }
void free(void* p) {
  if (counting && p) held -= static_cast<long>(malloc_usable_size(p));
  __libc_free(p);
}
void* realloc(void* p, size_t n) {
  if (counting && p) held -= static_cast<long>(malloc_usable_size(p));
  return note(__libc_realloc(p, n));
}
void* memalign(size_t alignment, size_t n) { return note(__libc_memalign(alignment, n)); }
void* aligned_alloc(size_t alignment, size_t n) { return note(__libc_memalign(alignment, n)); }
int posix_memalign(void** p, size_t alignment, size_t n) {
  *p = note(__libc_memalign(alignment, n));
  return *p ? 0 : ENOMEM;
}
}

namespace {

/// Counts while it lives.
class Watch {
 public:
  Watch() {
    void* warm[2];
    backtrace(warm, 2);
    counted = held = 0;
    counting = true;
  }
  ~Watch() { counting = false; }
  long stop() {
    counting = false;
    return counted;
  }
};

/// Where the first allocations came from.
std::string origins(long count, long first = 0) {
  std::set<std::string> texts;
  for (long t = first; t < std::min<long>(first + count, kTraces); ++t) {
    std::string text;
    for (int i = 1; i < depths[t]; ++i) {
      Dl_info info;
      if (!dladdr(traces[t][i], &info) || !info.dli_sname) continue;
      int status;
      char* name = abi::__cxa_demangle(info.dli_sname, nullptr, nullptr, &status);
      char at[32];  // for addr2line
      std::snprintf(
          at, sizeof at, "    0x%zx ",
          reinterpret_cast<size_t>(traces[t][i]) - reinterpret_cast<size_t>(info.dli_fbase));
      text += at + std::string(status == 0 ? name : info.dli_sname).substr(0, 120) + "\n";
      std::free(name);
    }
    texts.insert(text);
  }
  std::string all = std::to_string(count) + " allocations\n";
  for (const std::string& t : texts) all += t + "    --\n";
  return all;
}

/// Hands everything on, counts trials, and does not let renew() count.
template <class Kind>
class Wrapped : public Kind {
 public:
  explicit Wrapped(Kind& inner) : inner_(inner) {}
  mutable long trials = 0;
  long renewals = 0, in_renewals = 0;
  std::string where;  // in renewals

  int shared_size() const override { return inner_.shared_size(); }
  const std::vector<GroupShape>& groups() const override { return inner_.groups(); }
  void set_workers(int count) override { inner_.set_workers(count); }
  void prepare(const VectorXd& state) override { inner_.prepare(state); }
  bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const override {
    return inner_.evaluate(group, state, worker, cost);
  }
  bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to,
                 Cost& cost) const override {
    return inner_.linearise(group, state, worker, to, cost);
  }
  void begin_piece(int worker) const override { inner_.begin_piece(worker); }
  void end_piece(int worker, const GroupEquations& to) const override {
    inner_.end_piece(worker, to);
  }
  bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const override {
    return inner_.square_root(group, state, worker, rows);
  }
  void retract(const VectorXd& state, const VectorXd& shared, const VectorXd& own,
               VectorXd& moved) const override {
    ++trials;
    inner_.retract(state, shared, own, moved);
  }
  bool renew(const VectorXd& state) override {
    const long before = counted;
    const bool there = inner_.renew(state);
    ++renewals;
    const long here = counted - before;
    in_renewals += here;
    if (counting && here > 0 && where.empty()) {
      counting = false;
      where = origins(here, before);
      counting = true;
    }
    counted = before;
    return there;
  }

 protected:
  Kind& inner_;
};

class WrappedRanges final : public Wrapped<RangeProblem> {
 public:
  using Wrapped::Wrapped;
  bool evaluate_range(int first, int last, const VectorXd& state, int worker,
                      Cost& cost) const override {
    return inner_.evaluate_range(first, last, state, worker, cost);
  }
  void prepare_range(int first, int last, const VectorXd& state, int worker) const override {
    inner_.prepare_range(first, last, state, worker);
  }
  void recompute_rows(int first, int last, const VectorXd& state, const VectorXd& step, int worker,
                      double* rows) const override {
    inner_.recompute_rows(first, last, state, step, worker, rows);
  }
};

struct Found {
  long rejected = 0;     // of the last solve
  long undamped = 0;     // steps that the acceleration may act on
  long in_renewals = 0;  // of the second and third solve
  Outcome outcome = Outcome::not_converged;
};

/// Solves three times from `start`; the second and third may not allocate. `in_renew`: what renew()
/// allocates does not count.
template <class Wrapper, class Kind>
Found solve_thrice_as(Kind& problem, const VectorXd& start, const SolverOptions& options,
                      bool in_renew) {
  Wrapper wrapped(problem);
  LevenbergMarquardt solver(wrapped, options);
  VectorXd state = start;
  solver.solve(state);
  const VectorXd first = state;
  Found found;
  for (int again = 0; again < 2; ++again) {
    state = start;
    wrapped.trials = 0;
    wrapped.renewals = wrapped.in_renewals = 0;
    Watch watch;
    const SolveSummary& summary = solver.solve(state);
    const long count = watch.stop();
    if (count > 0) UNSCOPED_INFO("solve " << again + 2 << ": " << origins(count));
    CHECK(count == 0);
    if (!in_renew) {
      if (wrapped.in_renewals > 0)
        UNSCOPED_INFO("in " << wrapped.renewals << " renewals, first " << wrapped.where);
      CHECK(wrapped.in_renewals == 0);
    }
    CHECK(state == first);
    found.outcome = summary.outcome;
    found.rejected = wrapped.trials - summary.iterations;
    found.undamped = 0;
    for (const auto& [chi2, damping] : summary.history) found.undamped += damping <= 1e-9;
    found.in_renewals += wrapped.in_renewals;
  }
  return found;
}
Found solve_thrice(Problem& problem, const VectorXd& start, const SolverOptions& options,
                   bool in_renew = false) {
  return solve_thrice_as<Wrapped<Problem>>(problem, start, options, in_renew);
}
Found solve_thrice(RangeProblem& problem, const VectorXd& start, const SolverOptions& options,
                   bool in_renew = false) {
  return solve_thrice_as<WrappedRanges>(problem, start, options, in_renew);
}

const std::vector<Loss> kLosses = {
    {LossKind::none, 1}, {LossKind::huber, 2}, {LossKind::cauchy, 2}, {LossKind::tukey, 20}};

}  // namespace

TEST_CASE("allocations: they are counted") {
  // Otherwise all that follows proves nothing.
  Watch one;
  std::vector<double>* volatile v = new std::vector<double>(100);
  const long by_new = one.stop();
  CHECK(by_new == 2);
  delete v;
  MatrixXd m;
  Watch two;
  m.resize(30, 30);
  const long by_eigen = two.stop();
  CHECK(by_eigen == 1);
  Watch three;
  void* volatile p = std::aligned_alloc(64, 640);
  const long aligned = three.stop();
  CHECK(aligned == 1);
  std::free(p);
  Watch four;
  std::thread([] { std::free(std::malloc(100)); }).join();
  CHECK(four.stop() >= 2);
}

TEST_CASE("allocations: a PR2-like robot solved again allocates nothing") {
  benchmarks::RobotProblem p = benchmarks::pr2_like(24);
  for (JointSettings& j : p.rig.joints) j.sigma = 0.001;
  Random random(901);
  long rejected = 0, undamped = 0;
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent})
    for (const Loss& loss : kLosses)
      for (const bool far : {false, true})
        for (const int threads : {1, 2})
          for (const double decrease : {0.0, 1e-6}) {
            if (decrease > 0 && (far || loss.kind != LossKind::none)) continue;
            EstimationSetup setup = p.setup;
            setup.noise = mode;
            setup.loss = loss;
            Estimation problem(p, p.training(), setup);
            Values values = p.start;
            if (far)
              for (auto& [key, pose] : values.targets)
                pose = to_pose(isometry(pose) * exponential(random.twist(0.1, 0.4)));
            SolverOptions options;
            options.threads = threads;
            options.relative_decrease = decrease;
            options.max_iterations = 60;
            INFO("mode " << static_cast<int>(mode) << ", loss " << static_cast<int>(loss.kind)
                         << ", " << threads << " threads, far " << far << ", relative decrease "
                         << decrease);
            const Found found = solve_thrice(problem, problem.pack(values), options);
            if (!far && loss.kind == LossKind::none) CHECK(found.outcome == Outcome::converged);
            rejected += found.rejected;
            undamped += found.undamped;
          }
  CHECK(rejected > 0);
  CHECK(undamped > 20);
}

TEST_CASE(
    "allocations: a robot with every type of sensor solved again allocates nothing, but for "
    "covariances that are renewed") {
  long rejected = 0, undamped = 0;
  for (const NoiseMode mode :
       {NoiseMode::none, NoiseMode::latent, NoiseMode::marginal, NoiseMode::point}) {
    long in_renewals = 0;
    for (const Loss& loss : kLosses)
      for (const double off : {5e-3, 0.05})
        for (const int threads : {1, 2}) {
          Setting s = nasty_in(mode, loss, 8, 911, off);
          EstimationSetup setup = s.problem->setup();
          for (const Freed& f : setup.free)
            for (const int c : f.components) setup.priors.push_back({f.parameter, c, 1.0});
          if (off > 0.01) s.problem = std::make_unique<Estimation>(s, s.training(), setup);
          SolverOptions options;
          options.threads = threads;
          options.max_iterations = 60;
          options.linear_solver = LinearSolver::dense;
          INFO("mode " << static_cast<int>(mode) << ", loss " << static_cast<int>(loss.kind) << ", "
                       << threads << " threads, off " << off);
          const bool may = mode == NoiseMode::marginal || mode == NoiseMode::point;
          const Found found = solve_thrice(*s.problem, s.start(), options, may);
          rejected += found.rejected;
          undamped += found.undamped;
          in_renewals += found.in_renewals;
        }
    if (in_renewals > 0)
      WARN("mode " << static_cast<int>(mode) << ": " << in_renewals << " allocations in renewals");
  }
  CHECK(rejected > 0);
  CHECK(undamped > 20);
}

TEST_CASE("allocations: reload() allocates nothing") {
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent}) {
    Setting s = nasty_in(mode, {}, 8, 921, 5e-3);
    SolverOptions options;
    options.linear_solver = LinearSolver::dense;
    LevenbergMarquardt solver(*s.problem, options);
    VectorXd state = s.start();
    solver.solve(state);
    for (Sample& sample : s.samples)
      for (View& v : sample.views)
        for (double& z : v.z) z *= 1 + 1e-6;
    state = s.start();
    Watch watch;
    s.problem->reload();
    solver.solve(state);
    const long count = watch.stop();
    if (count > 0) UNSCOPED_INFO(origins(count));
    CHECK(count == 0);
  }
}

TEST_CASE("allocations: a calibration whose samples are replaced solves again without any") {
  for (const NoiseMode mode : {NoiseMode::none, NoiseMode::latent})
    for (const int threads : {1, 2}) {
      INFO("mode " << static_cast<int>(mode) << ", " << threads << " threads");
      Setting s = nasty_in(mode, {}, 8, 941, 5e-3);
      Step step;
      step.name = "all";
      step.sensors = all_sensors(s.rig);
      step.free = kDetermined;
      s.rig.steps = {step};
      CalibrationOptions options;
      options.noise = mode;
      options.threads = threads;
      options.linear_solver = LinearSolver::dense;
      Calibration calibration(make_recording(s.rig, s.samples), options);
      REQUIRE(calibration.solve().usable());
      for (int again = 0; again < 2; ++again) {
        for (Sample& sample : s.samples) {
          for (double& reading : sample.readings) reading += 1e-5;
          sample.noise.assign(sample.readings.size(), again == 0 ? 1.01 : 0.99);
          for (View& v : sample.views)
            for (double& z : v.z) z *= 1 + 1e-6;
        }
        Watch watch;
        for (size_t i = 0; i < s.samples.size(); ++i)
          calibration.replace(static_cast<int>(i), s.samples[i]);
        const Solution& solution = calibration.solve();
        const long count = watch.stop();
        if (count > 0) UNSCOPED_INFO(origins(count));
        CHECK(count == 0);
        CHECK(solution.usable());
      }
    }
}

TEST_CASE("allocations: a monitor adds samples of known forms without any") {
  Rig rig;
  add_two_joints(rig, 0.0005);
  finish_tree(rig.tree);
  add_marks_and_tracker(rig);
  add_eye(rig);
  Step all;
  all.name = "all";
  all.sensors = {0, 1};
  all.free = {"sensor/*/pose", "joint/elbow/offset"};
  rig.steps = {all};
  Random random(17);
  const auto logged = [&](int count) {
    std::vector<Sample> out;
    for (int n = 0; n < count; ++n) {
      const TruePosture p = random_posture(rig, random, 0.5, true);
      out.push_back(make_sample(rig, p, "s" + std::to_string(n)));
      for (const int sensor : {0, 1})  // every third sample lacks the camera
        if (sensor == 0 || n % 3 > 0) REQUIRE(add_view(out.back(), rig, sensor, 0, p, &random));
    }
    return out;
  };
  Calibration calibration(make_recording(rig, logged(30)));
  const Solution& found = calibration.solve();
  REQUIRE(found.usable());
  Monitor monitor({found.rig(), found.values.shared, found.columns, found.covariance, {}, {}});
  std::vector<Sample> samples = logged(200);
  for (double& z : samples[50].views[0].z) z += 0.1;
  Innovation innovation;
  innovation.sensors.reserve(2);
  for (size_t i = 0; i < 3; ++i) monitor.prepare(samples[i]);
  CHECK(monitor.samples() == 0);
  Watch watch;
  for (const Sample& sample : samples) monitor.add(sample, innovation);
  const long count = watch.stop();
  if (count > 0) UNSCOPED_INFO(origins(count));
  CHECK(count == 0);
  CHECK(monitor.samples() == 200);
  CHECK(monitor.outliers() == 1);
}

TEST_CASE("allocations: a monitor starts a free board from pixels without any") {
  Rig rig;
  add_two_joints(rig, 0.0005);
  finish_tree(rig.tree);
  add_eye(rig);
  Pose beside = rig.sensors[0].link_T_sensor;
  beside.translation.y() += 0.2;
  add_camera(rig, "other", "base", beside);
  add_grid(rig, "board", 5, 6, 0.03);
  Step all;
  all.name = "all";
  all.sensors = {0, 1};
  all.free = {"sensor/other/pose"};
  rig.steps = {all};
  Random random(19);
  std::vector<Sample> samples;
  while (samples.size() < 150) {
    TruePosture p = random_posture(rig, random, 0.5, true);
    p.boards[0] = in_front(rig, 0, 0, p, 0.8, 0.6, random);
    Sample sample = make_sample(rig, p, "s" + std::to_string(samples.size()));
    const bool first = add_view(sample, rig, 0, 0, p, &random),
               second = add_view(sample, rig, 1, 0, p, &random);
    if (first && second && sample.views[0].ids.size() == 30 && sample.views[1].ids.size() == 30)
      samples.push_back(sample);
  }
  Calibration calibration(
      make_recording(rig, std::vector<Sample>(samples.begin(), samples.begin() + 30)));
  const Solution& found = calibration.solve();
  REQUIRE(found.usable());
  const CalibratedState state = {
      found.rig(), found.values.shared, found.columns, found.covariance, {}, {}};
  Monitor monitor(state), other(state);
  monitor.prepare(samples[0]);
  Innovation innovation;
  innovation.sensors.reserve(2);
  long fits = 0;
  for (const Sample& sample : samples) {
    Watch watch;
    monitor.add(sample, innovation);
    const long count = watch.stop();
    INFO(origins(count));
    CHECK(count == 0);
    fits += innovation.state == SampleState::fits;
    CHECK(other.add(sample).chi2 == innovation.chi2);  // it need not be prepared
  }
  CHECK(fits == 150);
}

TEST_CASE("allocations: the memory of a monitor is what the formula says") {
  mallopt(M_MMAP_THRESHOLD, 1 << 25);  // blocks are not rounded to pages
  std::vector<Rig> rigs(1);
  add_two_joints(rigs[0], 0.0005);
  finish_tree(rigs[0].tree);
  add_marks_and_tracker(rigs[0]);
  add_eye(rigs[0]);
  rigs.push_back(nasty_robot());
  rigs.push_back(benchmarks::pr2_like(2).rig);
  for (const Rig& rig : rigs) {
    const ParameterTable table(rig);
    CalibratedState state{rig, table.initial, {}, {}, {}, {}};
    state.columns = components_of(freed(table, {"sensor/*/pose", "joint/*/offset"}));
    const auto n = static_cast<Eigen::Index>(state.columns.size());
    state.covariance = 1e-6 * MatrixXd::Identity(n, n);
    const auto said = static_cast<double>(monitor_memory(state));
    std::unique_ptr<Monitor> monitor;
    {
      Watch watch;
      monitor = std::make_unique<Monitor>(state);
    }
    const auto taken = static_cast<double>(held);
    INFO(monitor->columns().size() << " columns");
    CHECK(taken <= said);
    CHECK(taken >= 0.95 * said);
  }
}

TEST_CASE("allocations: bundle adjustment solved again allocates nothing") {
  Random random(931);
  BundleAdjustmentData d;
  for (int c = 0; c < 10; ++c) {
    const Vector3d w = random.vector(1);
    d.cameras.insert(d.cameras.end(),
                     {w.x(), w.y(), w.z(), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3),
                      random.uniform(-7, -5), random.uniform(400, 600), 0.02, 0.001});
  }
  for (int p = 0; p < 200; ++p) {
    const Vector3d at = random.vector(1);
    d.points.insert(d.points.end(), {at.x(), at.y(), at.z()});
    for (int c = 0; c < 10; ++c) {
      if ((c + p) % 10 >= 6) continue;
      const double* k = &d.cameras[9 * c];
      const Vector3d w(k[0], k[1], k[2]),
          q = Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix() * at +
              Vector3d(k[3], k[4], k[5]);
      d.camera_of.push_back(c);
      d.point_of.push_back(p);
      for (int i = 0; i < 2; ++i) d.pixels.push_back(-k[6] * q(i) / q.z() + random.normal());
    }
  }
  long rejected = 0;
  for (const double off : {0.01, 0.8}) {
    BundleAdjustmentData start = d;
    for (double& x : start.points) x += off * random.normal();
    for (size_t i = 0; i < start.cameras.size(); ++i)
      start.cameras[i] += (i % 9 < 6 ? off : 0) * random.normal();
    for (const int threads : {1, 2})
      for (const double decrease : {0.0, 1e-6}) {
        BundleAdjustment problem(start);
        SolverOptions options;
        options.threads = threads;
        options.relative_decrease = decrease;
        options.linear_solver = LinearSolver::dense;
        options.max_iterations = 60;
        INFO(threads << " threads, off " << off);
        const Found found = solve_thrice(problem, problem.initial(), options);
        rejected += found.rejected;
      }
  }
  CHECK(rejected > 0);
}
