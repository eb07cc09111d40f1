/* Texts and structs with mistakes for kincal.h: kincal_c_fuzz FOLDER SECONDS [SEED]   (fuzz_test.py
 * makes the folder: cases 0, 1, ... with N.urdf, N.yaml, N.jsonl, and the samples as numbers,
 * N.txt.)
 *
 * Proves, best with the sanitizers: whatever stands in texts and structs, every call ends with a
 * status that blames the input, never KINCAL_INTERNAL, and makes nothing where it fails; texts are
 * read to their ends and no further; a monitor that refused something goes on as one that never saw
 * it. The mistakes are the same for a seed. Does not prove that messages are good ones. */
#include <kincal.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { kMostReadings = 32, kMostViews = 16, kMostNumbers = 256, kFileCount = 6 };

static const char* folder;
static unsigned long rounds, refused, calibrated, shown;
static uint64_t state = 1;

static uint64_t below(uint64_t end) {
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return end ? (state >> 11) % end : 0;
}

static void stop(const char* what, const char* more) {
  printf("round %lu: %s: %s\n", rounds, what, more);
  exit(1);
}

/* ---------------------------------------------------------------------------- texts */
typedef struct text {
  char* data;
  size_t size;
} text;

static text copy_of(const char* data, size_t size) {
  text out;
  out.size = size;
  out.data = malloc(size ? size : 1); /* nothing behind it */
  if (!out.data) exit(1);
  memcpy(out.data, data, size);
  return out;
}

static text file(int number, const char* ending) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%d.%s", folder, number, ending);
  text out = {NULL, 0};
  FILE* in = fopen(path, "rb");
  if (!in) return out;
  char* data = malloc(1 << 20);
  const size_t size = data ? fread(data, 1, 1 << 20, in) : 0;
  fclose(in);
  out = copy_of(data, size);
  free(data);
  return out;
}

/* Puts `by` in place of `length` bytes at `at`. */
static void splice(text* t, size_t at, size_t length, const char* by, size_t size) {
  if (at > t->size) at = t->size;
  if (length > t->size - at) length = t->size - at;
  text out;
  out.size = t->size - length + size;
  out.data = malloc(out.size ? out.size : 1);
  if (!out.data) exit(1);
  memcpy(out.data, t->data, at);
  memcpy(out.data + at, by, size);
  memcpy(out.data + at + size, t->data + at + length, t->size - at - length);
  free(t->data);
  *t = out;
}

static void mutate(text* t) {
  static const char* const words[] = {"0",     "-1",       "1e308",        "1e-320", "nan",
                                      "\"\"",  "null",     "[]",           "{}",     "[[]]",
                                      "~",     "'",        "\"",           ":",      "- ",
                                      "\n",    "\t",       "&a ",          "*a",     "!!x ",
                                      "\xff",  "<a/>",     "2e9",          "0x10",   ",",
                                      "true",  "*",        "[[0, 0, 0]]",  "---\n",  "inf",
                                      "&#0;",  "\\u0000",  "999999999999", "joint/", "pose",
                                      "split", "\"test\"", "covariance: "};
  static const char separators[] = " \n\t,:[]{}<>\"'=/";
  for (uint64_t n = 1 + below(2); n > 0 && t->size > 0; --n) {
    const size_t at = below(t->size + 1), length = below(20);
    size_t begin = at, end = at;
    while (begin < t->size && strchr(separators, t->data[begin])) ++begin;
    for (end = begin; end < t->size && t->data[end] && !strchr(separators, t->data[end]);) ++end;
    const char* word = words[below(sizeof words / sizeof *words)];
    switch (below(7)) {
      case 0:
        splice(t, at, length, "", 0);
        break;
      case 1:
        splice(t, at, 0, word, strlen(word));
        break;
      case 2: {
        const size_t from = below(t->size);
        const text piece =
            copy_of(t->data + from, 10 * length < t->size - from ? 10 * length : t->size - from);
        splice(t, at, 0, piece.data, piece.size);
        free(piece.data);
        break;
      }
      case 3:
        if (below(4) == 0) splice(t, at, t->size, "", 0);
        break;
      case 4:
        splice(t, begin, end - begin, word, strlen(word));
        break;
      case 5: { /* a number near the one that stands there */
        char number[40], *rest = number;
        const size_t size = end - begin < 30 ? end - begin : 30;
        memcpy(number, t->data + begin, size);
        number[size] = 0;
        const double value = strtod(number, &rest);
        if (size == 0 || *rest) break;
        snprintf(number, sizeof number, "%.9g",
                 below(2) ? value * (double)(1 + below(3)) : value + (double)below(100) / 50 - 1);
        splice(t, begin, end - begin, number, strlen(number));
        break;
      }
      default:
        if (at < t->size) t->data[at] = (char)below(256);
    }
  }
}

static kincal_text given(text t, const char* name) {
  const kincal_text out = {t.data, t.size, name};
  return out;
}

/* Returns whether a call succeeded; it ends the program where it was no mistake of the input. */
static int good(kincal_status status, const kincal_error* error, const void* made) {
  if (status == KINCAL_OK) return 1;
  ++refused;
  if (status != error->status || memchr(error->message, 0, sizeof error->message) == NULL ||
      !error->message[0])
    stop("no message", error->message);
  if (status == KINCAL_INTERNAL || status == KINCAL_MEMORY || status == KINCAL_TOO_SMALL)
    stop("status", error->message);
  if (made) stop("made although it failed", error->message);
  return 0;
}

/* Slow is not wrong: what takes longer than a second or two is given up. */
static int32_t listen(const kincal_news* news, void* user) {
  (void)news;
  return clock() > *(clock_t*)user;
}

/* ---------------------------------------------------------------------------- cases */
typedef struct sample_numbers {
  double readings[kMostReadings];
  int count, views;
  kincal_view view[kMostViews];
} sample_numbers;

typedef struct made_case {
  text urdf, rig, samples;
  kincal_problem* problem;
  kincal_result* result;
  text files[kFileCount];
  sample_numbers* numbers;
  int count;
} made_case;

static const char* const kFiles[kFileCount] = {"rig.yaml",       "robot.urdf",  "result.json",
                                               "covariance.csv", "samples.csv", "residuals.csv"};

static void read_numbers(made_case* c, int number) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%d.txt", folder, number);
  FILE* in = fopen(path, "r");
  c->numbers = calloc(64, sizeof *c->numbers);
  while (c->count < 64 && fscanf(in, "%d", &c->numbers[c->count].count) == 1) {
    sample_numbers* s = &c->numbers[c->count++];
    for (int i = 0; i < s->count; ++i)
      if (fscanf(in, "%lf", &s->readings[i]) != 1) exit(1);
    if (fscanf(in, "%d", &s->views) != 1 || s->views > kMostViews) exit(1);
    for (int v = 0; v < s->views; ++v) {
      int sensor, target, ids, z;
      if (fscanf(in, "%d %d %d", &sensor, &target, &ids) != 3 || ids > kMostNumbers) exit(1);
      int32_t* id = malloc(((size_t)ids + 1) * sizeof *id);
      for (int i = 0; i < ids; ++i)
        if (fscanf(in, "%d", &id[i]) != 1) exit(1);
      if (fscanf(in, "%d", &z) != 1 || z > kMostNumbers) exit(1);
      double* numbers = malloc(((size_t)z + 1) * sizeof *numbers);
      for (int i = 0; i < z; ++i)
        if (fscanf(in, "%lf", &numbers[i]) != 1) exit(1);
      const kincal_view view = {sensor, target, id, (size_t)ids, numbers, (size_t)z, NULL, 0};
      s->view[v] = view;
    }
  }
  fclose(in);
}

static int read_case(made_case* c, int number) {
  memset(c, 0, sizeof *c);
  c->urdf = file(number, "urdf");
  if (!c->urdf.data) return 0;
  c->rig = file(number, "yaml");
  c->samples = file(number, "jsonl");
  kincal_error error = KINCAL_ERROR_INIT;
  const kincal_text urdf = given(c->urdf, NULL), rig = given(c->rig, NULL),
                    samples = given(c->samples, NULL);
  if (kincal_problem_new(&rig, &urdf, &samples, &c->problem, &error) ||
      kincal_calibrate(c->problem, NULL, NULL, &c->result, &error))
    stop("a case is refused", error.message);
  for (int i = 0; i < kFileCount; ++i) {
    size_t needed = 0;
    kincal_result_file(c->result, kFiles[i], NULL, 0, &needed, NULL);
    c->files[i] = copy_of("", 0);
    if (needed == 0) continue;
    free(c->files[i].data);
    c->files[i].data = malloc(needed);
    c->files[i].size = needed - 1;
    if (kincal_result_file(c->result, kFiles[i], c->files[i].data, needed, NULL, &error))
      stop("no file", error.message);
  }
  read_numbers(c, number);
  return 1;
}

/* ---------------------------------------------------------------------------- rounds */
static void use(const kincal_result* result) {
  kincal_error error = KINCAL_ERROR_INIT;
  double readings[kMostReadings], pose[16];
  for (int i = 0; i < kMostReadings; ++i)
    readings[i] = below(20) ? (double)below(1000) / 500 - 1 : below(2) ? 1e300 : NAN;
  size_t joints = 0, frames = 0;
  while (kincal_result_name(result, KINCAL_JOINTS, joints)) ++joints;
  while (kincal_result_name(result, KINCAL_FRAMES, frames)) ++frames;
  if (joints > kMostReadings) return;
  const char* frame = kincal_result_name(result, KINCAL_FRAMES, below(frames + 1));
  good(
      kincal_result_forward(result, readings, joints, frame,
                            kincal_result_name(result, KINCAL_FRAMES, below(frames)), pose, &error),
      &error, NULL);
  kincal_compensation wish = {sizeof wish, frame, NULL, readings,          readings,
                              joints,      0,     0,    (int32_t)below(2), 0};
  good(kincal_result_compensate(result, &wish, &error), &error, NULL);
  good(kincal_result_compensate_at(result, 20, &wish, &error), &error, NULL);
  kincal_summary summary;
  summary.size = sizeof summary;
  if (!good(kincal_result_summary(result, &summary, &error), &error, NULL)) return;
  for (size_t i = 0; i < summary.components; ++i) {
    kincal_component component;
    component.size = sizeof component;
    if (!good(kincal_result_component(result, i, &component, &error), &error, NULL))
      stop("component", error.message);
  }
  size_t needed = 0;
  double* covariance = malloc((summary.rows * summary.rows + 1) * sizeof *covariance);
  if (kincal_result_covariance(result, covariance, summary.rows * summary.rows, &needed, &error) ||
      needed != summary.rows * summary.rows)
    stop("covariance", error.message);
  free(covariance);
  kincal_component some;
  some.size = sizeof some;
  if (summary.components > 0 &&
      kincal_result_component(result, below(summary.components), &some, &error) == KINCAL_OK) {
    const char* name = below(10) ? some.name : "joint/none";
    const kincal_names named = {&name, 1};
    double value = 0;
    good(kincal_result_covariance_of(result, &named, &value, 1, NULL, &error), &error, NULL);
  }
  if (good(kincal_result_residuals(result, NULL, 0, 0, &needed, &error), &error, NULL)) {
    kincal_residual* residuals = calloc(needed + 1, sizeof *residuals);
    if (kincal_result_residuals(result, residuals, sizeof *residuals, needed, NULL, &error))
      stop("residuals", error.message);
    for (size_t i = 0; i < needed; ++i)
      if (!kincal_result_name(result, KINCAL_SAMPLES, (size_t)residuals[i].sample))
        stop("residuals", "no such sample");
    free(residuals);
  }
  if (kincal_result_file(result, "report.html", NULL, 0, &needed, &error))
    good(error.status, &error, NULL);
}

static void fuzz_problem(const made_case* c) {
  static const char* const settings[] = {
      NULL,
      "{\"iterations\": 3}",
      "{\"noise\": \"marginal\", \"reject\": true}",
      "{\"holdout\": 2, \"no_report\": true}",
      "{\"estimate_noise\": true, \"iterations\": 2, \"free\": [\"joint/*/offset\"], \"fix\": "
      "\"sensor/*\"}",
      "{\"noise\": \"point\", \"cross_validate\": 2, \"restarts\": 2, \"threads\": 2, "
      "\"report_frame\": \"tool\"}"};
  text parts[3] = {copy_of(c->rig.data, c->rig.size), copy_of(c->urdf.data, c->urdf.size),
                   copy_of(c->samples.data, c->samples.size)};
  if (below(4)) mutate(&parts[below(8) < 5 ? 2 * below(2) : 1]);
  if (below(4) == 0) mutate(&parts[below(3)]);
  kincal_text texts[3];
  for (int i = 0; i < 3; ++i) texts[i] = given(parts[i], NULL);
  kincal_error error = KINCAL_ERROR_INIT;
  kincal_problem* problem = NULL;
  if (good(kincal_problem_new(&texts[0], below(50) ? &texts[1] : NULL, &texts[2], &problem, &error),
           &error, problem)) {
    clock_t end = clock() + 2 * CLOCKS_PER_SEC;
    const kincal_progress progress = {sizeof progress, listen, &end};
    const char* given_settings = settings[below(sizeof settings / sizeof *settings)];
    text own =
        copy_of(given_settings ? given_settings : "", given_settings ? strlen(given_settings) : 0);
    if (below(3) == 0) mutate(&own);
    splice(&own, own.size, 0, "", 1); /* its 0 */
    kincal_result* result = NULL;
    kincal_answer* answer = NULL;
    if (good(
            kincal_calibrate(problem, given_settings ? own.data : NULL, &progress, &result, &error),
            &error, result)) {
      ++calibrated;
      use(result);
    }
    kincal_result_free(result);
    if (good(kincal_evaluate(problem, NULL, &progress, &answer, &error), &error, answer)) {
      size_t needed = 0;
      if (kincal_answer_json(answer, NULL, 0, &needed, &error) || needed < 10)
        stop("answer", error.message);
    }
    kincal_answer_free(answer);
    answer = NULL;
    if (below(4) == 0)
      good(kincal_check(problem, NULL, &progress, &answer, &error), &error, answer);
    kincal_answer_free(answer);
    free(own.data);
  }
  kincal_problem_free(problem);
  for (int i = 0; i < 3; ++i) free(parts[i].data);
}

static void fuzz_result(const made_case* c) {
  kincal_text texts[kFileCount];
  text parts[kFileCount];
  for (int i = 0; i < kFileCount; ++i) parts[i] = copy_of(c->files[i].data, c->files[i].size);
  mutate(&parts[below(kFileCount)]);
  for (int i = 0; i < kFileCount; ++i) texts[i] = given(parts[i], kFiles[i]);
  kincal_error error = KINCAL_ERROR_INIT;
  kincal_result* result = NULL;
  if (good(kincal_result_read(texts, below(10) ? kFileCount : 3, &result, &error), &error,
           result)) {
    use(result);
    kincal_monitor* monitor = NULL;
    if (good(kincal_monitor_new(result, NULL, &monitor, &error), &error, monitor) && c->count > 0) {
      kincal_innovation innovation;
      innovation.size = sizeof innovation;
      sample_numbers* s = &c->numbers[below((uint64_t)c->count)];
      const kincal_sample sample = {sizeof sample,   sizeof *s->view,  "a",
                                    s->readings,     (size_t)s->count, s->view,
                                    (size_t)s->views};
      good(kincal_monitor_add(monitor, &sample, &innovation, &error), &error, NULL);
    }
    kincal_monitor_free(monitor);
  }
  kincal_result_free(result);
  for (int i = 0; i < kFileCount; ++i) free(parts[i].data);
}

static double odd_number(double number) {
  switch (below(9)) {
    case 0:
      return NAN;
    case 1:
      return INFINITY;
    case 2:
      return 1e308;
    case 3:
      return -1e-310;
    case 4:
      return 0;
    case 5:
      return -number;
    case 6:
      return number * 1e6;
    default:
      return number + (double)below(1000) / 1000;
  }
}

/* A sample with mistakes in copies of exactly its size. Returns whether anything was changed. */
static int fuzz_sample(const sample_numbers* s, kincal_monitor* monitor,
                       kincal_innovation* innovation, kincal_error* error) {
  kincal_view views[kMostViews];
  double* readings = malloc(((size_t)s->count + 1) * sizeof *readings);
  memcpy(readings, s->readings, (size_t)s->count * sizeof *readings);
  for (int i = 0; i < s->count; ++i)
    if (below(40) == 0) readings[i] = odd_number(readings[i]);
  void* owned[3 * kMostViews];
  int own = 0;
  for (int v = 0; v < s->views; ++v) {
    kincal_view* view = &views[v];
    *view = s->view[v];
    int32_t* ids = malloc((view->ids_count + 1) * sizeof *ids);
    double *z = malloc((view->z_count + 1) * sizeof *z), *sigma = malloc(6 * sizeof *sigma);
    memcpy(ids, view->ids, view->ids_count * sizeof *ids);
    memcpy(z, view->z, view->z_count * sizeof *z);
    owned[own++] = ids;
    owned[own++] = z;
    owned[own++] = sigma;
    for (size_t i = 0; i < view->ids_count; ++i)
      if (below(60) == 0) ids[i] = (int32_t)below(1 << 20) - (1 << below(19));
    for (size_t i = 0; i < view->z_count; ++i)
      if (below(60) == 0) z[i] = odd_number(z[i]);
    for (int i = 0; i < 6; ++i) sigma[i] = below(10) ? 0.001 : odd_number(0.001);
    view->ids = ids;
    view->z = z;
    if (below(6) == 0) {
      view->sigma = sigma;
      view->sigma_count = below(7);
    }
    if (below(20) == 0) view->ids_count = below(view->ids_count + 1);
    if (below(20) == 0) view->z_count = below(view->z_count + 1);
    if (below(20) == 0) view->sensor = (int32_t)below(8) - 1;
    if (below(20) == 0) view->target = (int32_t)below(6) - 1;
    if (below(40) == 0) view->ids = NULL;
  }
  kincal_sample sample = {sizeof sample, sizeof *views,   "a", readings, (size_t)s->count,
                          views,         (size_t)s->views};
  if (below(30) == 0) sample.readings_count = below((uint64_t)s->count + 1);
  if (below(30) == 0) sample.views_count = below((uint64_t)s->views + 1);
  const int ok = good(kincal_monitor_add(monitor, &sample, innovation, error), error, NULL);
  while (own > 0) free(owned[--own]);
  free(readings);
  return ok;
}

static void fuzz_monitor(const made_case* c) {
  kincal_error error = KINCAL_ERROR_INIT;
  kincal_monitor* monitor = NULL;
  if (!good(kincal_monitor_new(c->result, NULL, &monitor, &error), &error, monitor))
    stop("monitor", error.message);
  kincal_innovation innovation;
  memset(&innovation, 0, sizeof innovation);
  innovation.size = sizeof innovation;
  int64_t taken = 0;
  for (int i = 0; i < 12; ++i) {
    if (below(3) == 0) {
      const char *begin = c->samples.data, *end = memchr(begin, '\n', c->samples.size);
      text line = copy_of(begin, end ? (size_t)(end - begin) : c->samples.size);
      mutate(&line);
      const kincal_text one = given(line, NULL);
      taken += good(kincal_monitor_add_json(monitor, &one, &innovation, &error), &error, NULL);
      free(line.data);
    } else {
      taken += fuzz_sample(&c->numbers[below((uint64_t)c->count)], monitor, &innovation, &error);
    }
    kincal_counts counts = {sizeof counts, 0, 0, 0};
    if (kincal_monitor_counts(monitor, &counts, &error) || counts.samples != taken)
      stop("counts", "");
    size_t moved = 0;
    if (below(4) == 0 && good(kincal_monitor_find(monitor, &moved, &error), &error, NULL) &&
        moved > 0) {
      kincal_moved found;
      kincal_change change;
      found.size = sizeof found;
      change.size = sizeof change;
      if (kincal_monitor_moved(monitor, moved - 1, &found, &error)) stop("moved", error.message);
      for (size_t k = 0; k < found.changes; ++k)
        if (kincal_monitor_change(monitor, moved - 1, k, &change, &error))
          stop("change", error.message);
      if (below(3) == 0)
        good(kincal_monitor_restart(monitor, (int32_t)below(2), &error), &error, NULL);
    }
    for (size_t k = 0; k < counts.noise; ++k) {
      kincal_noise noise;
      noise.size = sizeof noise;
      if (kincal_monitor_noise(monitor, k, &noise, &error)) stop("noise", error.message);
    }
  }
  shown += (unsigned long)taken;
  text lines = copy_of(c->samples.data, c->samples.size);
  if (below(2)) mutate(&lines);
  const kincal_text window_text = given(lines, NULL);
  const char* group = below(10) ? kincal_monitor_name(monitor, KINCAL_GROUPS, 0) : "none";
  kincal_window window;
  memset(&window, 0, sizeof window);
  window.size = sizeof window;
  window.lines = &window_text;
  window.groups.names = &group;
  window.groups.count = group ? 1 : 0;
  window.iterations = (int32_t)below(4) - 1;
  kincal_recalibration done = {sizeof done, 0, 0};
  if (good(kincal_monitor_recalibrate(monitor, &window, &done, &error), &error, NULL))
    for (size_t k = 0; k < done.components; ++k) {
      kincal_recalibrated component;
      component.size = sizeof component;
      if (kincal_monitor_recalibrated(monitor, k, &component, &error))
        stop("recalibrated", error.message);
    }
  free(lines.data);
  kincal_monitor_free(monitor);
}

int main(int argc, char** argv) {
  if (argc < 3) return 1;
  folder = argv[1];
  const double seconds = atof(argv[2]);
  const uint64_t seed = argc > 3 ? strtoull(argv[3], NULL, 10) : 1,
                 first = seed / 1000000 * 1000000;
  static made_case cases[8]; /* until the end */
  int count = 0;
  while (count < 8 && read_case(&cases[count], count)) ++count;
  if (count == 0) return 1;
  const time_t end = time(NULL) + (time_t)seconds;
  /* A round has a seed of its own: SEED of the one that failed repeats it. */
  for (rounds = (unsigned long)(seed - first); time(NULL) < end; ++rounds) {
    state = (first + rounds + 1) * 0x9E3779B97F4A7C15ull;
    for (int i = 0; i < 8; ++i) below(2);
    FILE* last = fopen("last-round", "w");
    if (last) {
      fprintf(last, "%llu\n", (unsigned long long)(first + rounds));
      fclose(last);
    }
    const made_case* c = &cases[below((uint64_t)count)];
    const uint64_t kind = below(5);
    if (kind < 2) {
      fuzz_problem(c);
    } else if (kind == 2) {
      fuzz_result(c);
    } else {
      fuzz_monitor(c);
    }
  }
  printf("%lu rounds: %lu refusals, %lu calibrations, %lu samples shown to monitors\n",
         rounds - (unsigned long)(seed - first), refused, calibrated, shown);
  return refused > 0 && calibrated > 0 && shown > 0 ? 0 : 1;
}
