/* A program in C99 that uses kincal.h: kincal_c_test FOLDER (made by c_test.py: rig.yaml,
 * robot.urdf, samples.jsonl, later.jsonl and moved.jsonl of the arm of the examples, and the latter
 * two as numbers, later.txt and moved.txt).
 *
 * Proves: an arm is calibrated from texts in memory; the result read back from its texts is the
 * same; poses, covariance and its blocks, residuals as in the file; evaluation, check and plans; a
 * monitor that is shown structs says what one says that is shown the same as JSON, and finds what
 * moved, and allocates nothing for prepared forms; a recalibration finds the new pose; wrong input
 * is refused with status, file, line and name, and what was called works as before; structs of
 * other sizes; a listener that cancels; several threads on one problem and result. Files of the
 * result are written to FOLDER/c, for c_test.py to compare. Does not prove: that the numbers are
 * right (the other tests do). */
#include <kincal.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Allocations while `counting`, of the library too; where malloc is glibc's. */
static volatile int counting = 0;
static long allocations = 0;
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* p, size_t size);
void* __libc_memalign(size_t alignment, size_t size);
void* malloc(size_t size) {
  if (counting) ++allocations;
  return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
  if (counting) ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* p, size_t size) {
  if (counting) ++allocations;
  return __libc_realloc(p, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
  if (counting) ++allocations;
  return __libc_memalign(alignment, size);
}
#endif

static int failures = 0;
#define CHECK(condition)                                     \
  do {                                                       \
    if (!(condition)) {                                      \
      ++failures;                                            \
      printf("%s:%d: %s\n", __FILE__, __LINE__, #condition); \
    }                                                        \
  } while (0)
/* Ends the program where going on makes no sense. */
#define MUST(call)                                                     \
  do {                                                                 \
    kincal_error e = KINCAL_ERROR_INIT;                                \
    kincal_error* error = &e;                                          \
    if ((call) != KINCAL_OK) {                                         \
      printf("%s:%d: %s: %s\n", __FILE__, __LINE__, #call, e.message); \
      exit(1);                                                         \
    }                                                                  \
  } while (0)
/* A call that fails with this status, and this text in its message. */
#define FAILS(call, expected, text)                                                             \
  do {                                                                                          \
    memset(error, 0xAA, sizeof *error);                                                         \
    error->size = sizeof *error;                                                                \
    const kincal_status status = (call);                                                        \
    if (status != (expected) || error->status != (expected) || !strstr(error->message, text)) { \
      ++failures;                                                                               \
      printf("%s:%d: %s: status %d: %s\n", __FILE__, __LINE__, #call, (int)status,              \
             status ? error->message : "");                                                     \
    }                                                                                           \
  } while (0)
static kincal_error the_error = KINCAL_ERROR_INIT;
static kincal_error* const error = &the_error;

static const char* folder;

/* Texts that live until the end. */
static void* kept[64];
static void* keep(void* data) {
  static int count = 0;
  if (!data || count == 64) exit(1);
  return kept[count++] = data;
}

static kincal_text text_of(const char* data, const char* name) {
  kincal_text text;
  text.data = data;
  text.size = strlen(data);
  text.name = name;
  return text;
}

/* The text of a file of the folder. */
static kincal_text file(const char* name) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%s", folder, name);
  FILE* in = fopen(path, "rb");
  if (!in) {
    printf("%s cannot be read\n", path);
    exit(1);
  }
  fseek(in, 0, SEEK_END);
  const long size = ftell(in);
  rewind(in);
  char* data = keep(malloc((size_t)size + 1));
  if (fread(data, 1, (size_t)size, in) != (size_t)size) exit(1);
  data[size] = 0;
  fclose(in);
  return text_of(data, name);
}

static char* result_file(const kincal_result* result, const char* name) {
  size_t needed = 0;
  MUST(kincal_result_file(result, name, NULL, 0, &needed, error));
  char* out = malloc(needed);
  if (!out) exit(1);
  MUST(kincal_result_file(result, name, out, needed, &needed, error));
  CHECK(strlen(out) + 1 == needed);
  return out;
}

static kincal_summary summary_of(const kincal_result* result) {
  kincal_summary summary = {sizeof summary, 0, 0, 0, 0, {0}, {0}};
  MUST(kincal_result_summary(result, &summary, error));
  return summary;
}

static size_t names(const kincal_result* result, int32_t kind) {
  size_t count = 0;
  while (kincal_result_name(result, kind, count)) ++count;
  return count;
}

/* ---------------------------------------------------------------------------- results */
static kincal_problem* arm(void) {
  const kincal_text rig = file("rig.yaml"), urdf = file("robot.urdf"),
                    samples = file("samples.jsonl");
  kincal_problem* problem = NULL;
  MUST(kincal_problem_new(&rig, &urdf, &samples, &problem, error));
  return problem;
}

static int32_t count_news(const kincal_news* news, void* user) {
  CHECK(news->size == sizeof *news && news->what != NULL);
  ++*(int*)user;
  return 0;
}

static int32_t cancel(const kincal_news* news, void* user) {
  (void)news;
  return ++*(int*)user > 3;
}

static kincal_result* calibrated(const kincal_problem* problem) {
  int news = 0;
  const kincal_progress progress = {sizeof progress, count_news, &news};
  kincal_result* result = NULL;
  MUST(kincal_calibrate(problem, NULL, &progress, &result, error));
  CHECK(news > 10);
  return result;
}

static void test_result(const kincal_problem* problem, const kincal_result* result) {
  CHECK(kincal_problem_samples(problem) == 24);
  CHECK(strcmp(kincal_problem_name(problem, KINCAL_JOINTS, 0), "turn") == 0);
  CHECK(strcmp(kincal_problem_name(problem, KINCAL_SENSORS, 0), "camera") == 0);
  CHECK(strcmp(kincal_problem_name(problem, KINCAL_TARGETS, 0), "board") == 0);
  CHECK(kincal_problem_name(problem, KINCAL_TARGETS, 1) == NULL);
  CHECK(kincal_problem_name(problem, KINCAL_GROUPS, 0) == NULL &&
        kincal_problem_name(problem, -1, 0) == NULL);
  CHECK(names(result, KINCAL_JOINTS) == 6);

  const kincal_summary summary = summary_of(result);
  CHECK(strcmp(summary.status, "converged") == 0 && strcmp(summary.use, "good") == 0);
  CHECK(summary.dof > 1000 && summary.chi2 > 0.9 * (double)summary.dof &&
        summary.chi2 < 1.1 * (double)summary.dof);
  CHECK(summary.components > 10 && summary.rows >= summary.components / 2);

  size_t needed = 0;
  double* covariance = malloc(summary.rows * summary.rows * sizeof *covariance);
  MUST(kincal_result_covariance(result, covariance, summary.rows * summary.rows, &needed, error));
  CHECK(needed == summary.rows * summary.rows);
  int bend = 0, of_covariance = 0;
  for (size_t i = 0; i < summary.components; ++i) {
    kincal_component c;
    c.size = sizeof c;
    MUST(kincal_result_component(result, i, &c, error));
    if (c.row >= 0 && c.sigma > 0) {
      const size_t at = (size_t)c.row * (summary.rows + 1);
      CHECK(fabs(sqrt(covariance[at]) - c.sigma) < 1e-9 * c.sigma);
      ++of_covariance;
    }
    if (strcmp(c.name, "joint/bend/offset") == 0) {
      ++bend;
      CHECK(strcmp(c.unit, "rad") == 0 && c.initial == 0);
      CHECK(fabs(c.value - 0.0163) < 5 * c.sigma && c.sigma < 0.001);
    }
  }
  CHECK(bend == 1 && of_covariance > 10);
  free(covariance);

  for (size_t i = 0; kincal_result_file_name(result, i); ++i) {
    const char* name = kincal_result_file_name(result, i);
    char* text = result_file(result, name);
    char path[1024];
    snprintf(path, sizeof path, "%s/c/%s", folder, name);
    FILE* out = fopen(path, "wb");
    if (!out) exit(1);
    fwrite(text, 1, strlen(text), out);
    fclose(out);
    free(text);
  }
}

/* The result from its own texts. */
static void test_read_back(const kincal_result* result) {
  kincal_text files[4];
  const char* const wanted[4] = {"rig.yaml", "robot.urdf", "result.json", "covariance.csv"};
  for (int i = 0; i < 4; ++i) files[i] = text_of(keep(result_file(result, wanted[i])), wanted[i]);
  kincal_result* again = NULL;
  MUST(kincal_result_read(files, 4, &again, error));
  const kincal_summary a = summary_of(result), b = summary_of(again);
  CHECK(memcmp(&a, &b, sizeof a) == 0);
  for (size_t i = 0; i < a.components; ++i) {
    kincal_component c, d;
    memset(&c, 0, sizeof c);
    memset(&d, 0, sizeof d);
    c.size = d.size = sizeof c;
    MUST(kincal_result_component(result, i, &c, error));
    MUST(kincal_result_component(again, i, &d, error));
    CHECK(memcmp(&c, &d, sizeof c) == 0);
  }
  const double readings[6] = {0.1, -0.2, 0.3, 0.4, -0.5, 0.6};
  double poses[2][16];
  MUST(
      kincal_result_forward(result, readings, 6, "sensor/camera", "target/board", poses[0], error));
  MUST(kincal_result_forward(again, readings, 6, "sensor/camera", "target/board", poses[1], error));
  CHECK(memcmp(poses[0], poses[1], sizeof poses[0]) == 0);
  kincal_result_free(again);

  MUST(kincal_result_read(files, 3, &again, error)); /* without covariance */
  CHECK(summary_of(again).rows == 0);
  double none[2] = {1, 2};
  size_t needed = 9;
  MUST(kincal_result_covariance(again, none, 2, &needed, error));
  CHECK(needed == 0 && none[0] == 1);
  kincal_component c;
  c.size = sizeof c;
  MUST(kincal_result_component(again, 0, &c, error));
  CHECK(c.row == -1 && c.sigma > 0);
  kincal_monitor* monitor = NULL;
  FAILS(kincal_monitor_new(again, NULL, &monitor, error), KINCAL_INPUT, "has no covariance");
  CHECK(monitor == NULL);
  kincal_result_free(again);
  again = NULL;
  FAILS(kincal_result_read(files, 2, &again, error), KINCAL_INPUT, "result.json: is missing");
  FAILS(kincal_result_read(files + 2, 1, &again, error), KINCAL_INPUT, "rig.yaml: is missing");
  kincal_text wrong = files[1];
  wrong.name = "robots.urdf";
  FAILS(kincal_result_read(&wrong, 1, &again, error), KINCAL_INPUT,
        "'robots.urdf' is no file of a result; nearest: robot.urdf");
  CHECK(strcmp(error->name, "files") == 0);
  files[2] = text_of("{\"robot\": {}", "result.json");
  FAILS(kincal_result_read(files, 4, &again, error), KINCAL_INPUT, "result.json:1");
  CHECK(strcmp(error->file, "result/result.json") == 0 && error->line == 1);
  CHECK(again == NULL);
}

/* The block of some components is that of the whole covariance. */
static void test_covariance_of(const kincal_result* result) {
  const kincal_summary summary = summary_of(result);
  double* whole = malloc(summary.rows * summary.rows * sizeof *whole);
  MUST(kincal_result_covariance(result, whole, summary.rows * summary.rows, NULL, error));
  const char* const parts[] = {"sensor/camera/pose", "joint/bend/offset"};
  const kincal_names names_of_parts = {parts, 2};
  size_t needed = 0;
  MUST(kincal_result_covariance_of(result, &names_of_parts, NULL, 0, &needed, error));
  CHECK(needed == 49);
  double block[49];
  MUST(kincal_result_covariance_of(result, &names_of_parts, block, 49, NULL, error));
  int64_t rows[7] = {0};
  int found = 0;
  for (size_t i = 0; i < summary.components; ++i) {
    kincal_component c;
    c.size = sizeof c;
    MUST(kincal_result_component(result, i, &c, error));
    const int camera = strncmp(c.name, "sensor/camera/pose.", 19) == 0;
    const char* const axes[6] = {"x", "y", "z", "rx", "ry", "rz"};
    for (int k = 0; camera && k < 6; ++k)
      if (strcmp(c.name + 19, axes[k]) == 0) rows[k] = c.row, ++found;
    if (strcmp(c.name, "joint/bend/offset") == 0) rows[6] = c.row, ++found;
  }
  CHECK(found == 7);
  for (int i = 0; i < 7; ++i)
    for (int j = 0; j < 7; ++j)
      CHECK(block[7 * i + j] == whole[(size_t)rows[i] * summary.rows + (size_t)rows[j]]);
  free(whole);
  const char* one[2] = {"sensor/camera/pose.ry", NULL};
  kincal_names some = {one, 1};
  double value[2] = {0, 5};
  MUST(kincal_result_covariance_of(result, &some, value, 2, &needed, error));
  CHECK(needed == 1 && value[0] == block[7 * 4 + 4] && value[1] == 5);

  double before[49];
  memcpy(before, block, sizeof before);
  FAILS(kincal_result_covariance_of(result, &names_of_parts, block, 48, &needed, error),
        KINCAL_TOO_SMALL, "room for 48");
  CHECK(needed == 49);
  one[0] = "sensor/camra/pose";
  FAILS(kincal_result_covariance_of(result, &some, block, 49, NULL, error), KINCAL_INPUT,
        "no parameter 'sensor/camra/pose'; nearest: sensor/camera/pose");
  CHECK(strcmp(error->name, "names") == 0 && strstr(error->message, "names[0]: ") != NULL);
  one[0] = "joint/bend/origin";
  FAILS(kincal_result_covariance_of(result, &some, block, 49, NULL, error), KINCAL_INPUT,
        "was not estimated");
  one[0] = "joint/bend/offset";
  some.count = 2;
  FAILS(kincal_result_covariance_of(result, &some, block, 49, NULL, error), KINCAL_USAGE,
        "names[1]: is NULL");
  FAILS(kincal_result_covariance_of(result, NULL, block, 49, NULL, error), KINCAL_USAGE,
        "names: is NULL");
  CHECK(memcmp(before, block, sizeof before) == 0);
}

/* The residuals of a result are those of its file, of all samples and points. */
static void test_residuals(const kincal_problem* problem, const kincal_result* result) {
  size_t needed = 0;
  MUST(kincal_result_residuals(result, NULL, 0, 0, &needed, error));
  const char* const csv = keep(result_file(result, "residuals.csv"));
  size_t lines = 0;
  for (const char* c = csv; *c; ++c) lines += *c == '\n';
  CHECK(needed == lines - 1 && needed > 500);
  kincal_residual* residuals = calloc(needed, sizeof *residuals);
  MUST(kincal_result_residuals(result, residuals, sizeof *residuals, needed, NULL, error));
  const char* line = csv;
  for (size_t i = 0; i < needed; ++i) {
    const kincal_residual* r = &residuals[i];
    line = strchr(line, '\n') + 1;
    const char* id = kincal_result_name(result, KINCAL_SAMPLES, (size_t)r->sample);
    CHECK(strcmp(id, kincal_problem_name(problem, KINCAL_SAMPLES, (size_t)r->sample)) == 0);
    char start[256];
    snprintf(start, sizeof start, "%s,train,camera,board,%d,px,", id, (int)r->point);
    double x = 0, y = 0, before_x = 0, before_y = 0, whitened = 0;
    CHECK(strncmp(line, start, strlen(start)) == 0 &&
          sscanf(line + strlen(start), "%lf,%lf,,,,,%lf,%lf,,%lf,", &x, &y, &before_x, &before_y,
                 &whitened) == 5);
    CHECK(r->size == sizeof *r && r->sensor == 0 && r->target == 0 && r->count == 2 &&
          r->held_out == 0 && r->value[0] == x && r->value[1] == y && r->value[2] == 0 &&
          r->before[0] == before_x && r->before[1] == before_y && isnan(r->before[2]) &&
          r->whitened == whitened);
  }
  CHECK(kincal_result_name(result, KINCAL_SAMPLES, 24) == NULL);

  /* Of an evaluation: the samples are its own, and their squares add up. */
  const kincal_text later = file("later.jsonl");
  kincal_problem* other = NULL;
  kincal_answer *answer = NULL, *checked = NULL;
  MUST(kincal_result_problem(result, &later, &other, error));
  MUST(kincal_evaluate(other, "{\"noise\": \"none\"}", NULL, &answer, error));
  MUST(kincal_answer_residuals(answer, NULL, 0, 0, &needed, error));
  struct {
    kincal_residual residual;
    unsigned char behind[8];
  }* const newer = calloc(needed, sizeof *newer); /* a header of a later version */
  newer[0].behind[3] = 7;
  MUST(kincal_answer_residuals(answer, &newer->residual, sizeof *newer, needed, NULL, error));
  CHECK(newer[0].behind[3] == 7);
  double chi2 = 0, stated = 0;
  for (size_t i = 0; i < needed; ++i) {
    const kincal_residual* r = &newer[i].residual;
    CHECK(r->size == sizeof *newer && r->sample >= 0 && r->sample < 24 && r->count == 2 &&
          r->point >= 0 && isnan(r->before[0]));
    CHECK(i == 0 || r->sample >= newer[i - 1].residual.sample);
    chi2 += r->whitened * r->whitened;
  }
  char* json = malloc(100000);
  MUST(kincal_answer_json(answer, json, 100000, NULL, error));
  CHECK(sscanf(strstr(json, "\"chi2\":"), "\"chi2\": %lf", &stated) == 1);
  CHECK(fabs(chi2 - stated) < 1e-9 * stated);
  free(json);
  free(newer);

  FAILS(kincal_answer_residuals(answer, residuals, 8, needed, NULL, error), KINCAL_USAGE,
        "residual_size: 8");
  FAILS(kincal_answer_residuals(answer, residuals, sizeof *residuals, 3, &needed, error),
        KINCAL_TOO_SMALL, "room for 3");
  FAILS(kincal_answer_residuals(answer, NULL, sizeof *residuals, needed, NULL, error), KINCAL_USAGE,
        "buffer: is NULL");
  CHECK(residuals[0].whitened == residuals[0].whitened && residuals[0].sample == 0);
  MUST(kincal_check(other, NULL, NULL, &checked, error));
  FAILS(kincal_answer_residuals(checked, NULL, 0, 0, &needed, error), KINCAL_INPUT,
        "it has no residuals");
  kincal_answer_free(checked);
  kincal_answer_free(answer);
  kincal_problem_free(other);
  free(residuals);
  kincal_result* without = NULL;
  MUST(kincal_calibrate(problem, "{\"no_report\": true}", NULL, &without, error));
  FAILS(kincal_result_residuals(without, NULL, 0, 0, &needed, error), KINCAL_INPUT,
        "the result has no residuals.csv");
  kincal_result_free(without);
}

/* A plan after samples (c_test.py has one without, and an instrument for verifications). */
static void test_plans(const kincal_problem* problem, const kincal_result* result) {
  const kincal_text rig = text_of(keep(result_file(result, "rig.yaml")), "rig.yaml"),
                    urdf = text_of(keep(result_file(result, "robot.urdf")), "robot.urdf"),
                    later = file("later.jsonl");
  kincal_problem* empty = NULL;
  kincal_answer* answer = NULL;
  kincal_result* none = NULL;
  MUST(kincal_problem_new(&rig, &urdf, NULL, &empty, error));
  CHECK(kincal_problem_samples(empty) == 0 && kincal_problem_name(empty, 5, 0) == NULL);
  FAILS(kincal_calibrate(empty, NULL, NULL, &none, error), KINCAL_INPUT, "the problem has none");
  FAILS(kincal_evaluate(empty, NULL, NULL, &answer, error), KINCAL_INPUT, "the problem has none");
  FAILS(kincal_check(empty, NULL, NULL, &answer, error), KINCAL_INPUT, "the problem has none");
  size_t needed = 0;
  const char* const four = "{\"next\": 4, \"candidates\": 60, \"clearance\": null}";
  MUST(kincal_plan(problem, four, NULL, &answer, error));
  MUST(kincal_answer_file(answer, "postures.jsonl", NULL, 0, &needed, error));
  char* postures = malloc(needed);
  MUST(kincal_answer_file(answer, "postures.jsonl", postures, needed, NULL, error));
  size_t lines = 0;
  for (const char* c = postures; *c; ++c) lines += *c == '\n';
  CHECK(lines == 4 && strstr(postures, "\"bend\"") != NULL);
  FAILS(kincal_answer_file(answer, "posture.jsonl", NULL, 0, &needed, error), KINCAL_INPUT,
        "no text 'posture.jsonl'; nearest: postures.jsonl");
  free(postures);
  MUST(kincal_answer_json(answer, NULL, 0, &needed, error));
  CHECK(needed > 100);
  kincal_answer_free(answer);
  answer = NULL;
  MUST(kincal_plan(empty, four, NULL, &answer, error)); /* for a rig alone */
  kincal_answer_free(answer);
  answer = NULL;
  const struct {
    const char *settings, *name, *text;
  } wrong[] = {{"{\"nxt\": 4}", "nxt", "there is no such option; nearest: next"},
               {"{\"next\": 0}", "next", "an integer in 1 .. 1000"},
               {"{\"next\": 99999999999}", "next", "an integer in 1 .. 1000"},
               {"{\"next\": \"4\"}", "next", "an integer in 1 .. 1000"},
               {"{\"next\": -}", "", "settings:1"},
               {"{\"seed\": -1}", "seed", "an integer in 0 .."},
               {"{\"clearance\": 2}", "clearance", "a number in 0 .. 1 or null"},
               {"{\"clearance\": \"1\"}", "clearance", "a number in 0 .. 1 or null"},
               {"{\"goal\": 3}", "goal", "a text is expected"},
               {"{\"goal\": \"frame/flang\"}", "goal", "flang"},
               {"{\"postures\": \"{]\"}", "", "postures:1"},
               {"[]", "", "a mapping of options"}};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
    FAILS(kincal_plan(problem, wrong[i].settings, NULL, &answer, error), KINCAL_INPUT,
          wrong[i].text);
    if (strcmp(error->name, wrong[i].name) != 0)
      ++failures,
          printf("%s: name '%s', message %s\n", wrong[i].settings, error->name, error->message);
  }
  int news = 0;
  const kincal_progress progress = {sizeof progress, cancel, &news};
  FAILS(kincal_plan(problem, NULL, &progress, &answer, error), KINCAL_CANCELLED, "the listener");
  FAILS(kincal_plan_verification(empty, "{\"region\": [1, 2]}", NULL, &answer, error), KINCAL_INPUT,
        "region: 6 numbers");
  FAILS(kincal_plan_verification(empty, NULL, NULL, &answer, error), KINCAL_INPUT, "camera");
  FAILS(kincal_verify(result, &later, "{\"tolerance\": 1}", &answer, error), KINCAL_INPUT,
        "tolerance: a text is expected");
  FAILS(kincal_verify(result, &later, "{\"refit_base\": 1}", &answer, error), KINCAL_INPUT,
        "refit_base: true or false");
  FAILS(kincal_verify(result, &later, NULL, &answer, error), KINCAL_INPUT, "camera");
  FAILS(kincal_verify(result, NULL, NULL, &answer, error), KINCAL_USAGE, "samples: is NULL");
  CHECK(answer == NULL && none == NULL);
  kincal_problem_free(empty);
}

static void test_forward(const kincal_result* result) {
  double readings[6] = {0.1, -0.2, 0.3, 0.4, -0.5, 0.6}, pose[16], back[16];
  MUST(kincal_result_forward(result, readings, 6, "flange", NULL, pose, error));
  MUST(kincal_result_forward(result, readings, 6, "base", "flange", back, error));
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) {
      double product = 0;
      for (int k = 0; k < 4; ++k) product += pose[4 * i + k] * back[4 * k + j];
      CHECK(fabs(product - (i == j)) < 1e-12);
    }
  CHECK(pose[12] == 0 && pose[13] == 0 && pose[14] == 0 && pose[15] == 1);
  double before[16];
  memcpy(before, pose, sizeof before);
  FAILS(kincal_result_forward(result, readings, 5, "flange", NULL, pose, error), KINCAL_INPUT,
        "6 are expected, one a joint, not 5");
  CHECK(strcmp(error->name, "readings") == 0);
  FAILS(kincal_result_forward(result, readings, 6, "flangee", NULL, pose, error), KINCAL_INPUT,
        "no frame 'flangee'; nearest: flange");
  CHECK(strcmp(error->name, "frame") == 0);
  FAILS(kincal_result_forward(result, readings, 6, "flange", "bas", pose, error), KINCAL_INPUT,
        "no frame 'bas'; nearest: base");
  CHECK(strcmp(error->name, "base") == 0);
  readings[2] = INFINITY;
  FAILS(kincal_result_forward(result, readings, 6, "flange", NULL, pose, error), KINCAL_INPUT,
        "the reading of 'bend' is not finite");
  readings[2] = NAN;
  FAILS(kincal_result_forward(result, readings, 6, "flange", NULL, pose, error), KINCAL_INPUT,
        "no reading of joint 'bend', which moves 'flange'");
  FAILS(kincal_result_forward(result, NULL, 6, "flange", NULL, pose, error), KINCAL_USAGE,
        "readings: is NULL");
  FAILS(kincal_result_forward(result, readings, 6, NULL, NULL, pose, error), KINCAL_USAGE,
        "frame: is NULL");
  FAILS(kincal_result_forward(NULL, readings, 6, "flange", NULL, pose, error), KINCAL_USAGE,
        "result: is NULL");
  CHECK(memcmp(before, pose, sizeof before) == 0);
  MUST(kincal_result_forward(result, readings, 6, "target/board", "base", pose,
                             error)); /* it does not move */

  kincal_compensation wish = {sizeof wish, "flange", NULL, readings, readings, 6, 0, 0, 0, 0};
  FAILS(kincal_result_compensate(result, &wish, error), KINCAL_INPUT, "nothing to compensate");
  FAILS(kincal_result_compensate_at(result, 20, &wish, error), KINCAL_INPUT,
        "nothing to compensate");
}

static void test_evaluation(const kincal_result* result) {
  const kincal_text later = file("later.jsonl"), moved = file("moved.jsonl");
  for (int i = 0; i < 2; ++i) {
    kincal_problem* problem = NULL;
    kincal_answer* answer = NULL;
    MUST(kincal_result_problem(result, i ? &moved : &later, &problem, error));
    MUST(kincal_evaluate(problem, "{\"noise\": \"latent\"}", NULL, &answer, error));
    size_t needed = 0;
    MUST(kincal_answer_json(answer, NULL, 0, &needed, error));
    char* json = malloc(needed);
    MUST(kincal_answer_json(answer, json, needed, NULL, error));
    double chi2 = 0, dof = 0;
    CHECK(sscanf(strstr(json, "\"chi2\":"), "\"chi2\": %lf", &chi2) == 1 &&
          sscanf(strstr(json, "\"dof\":"), "\"dof\": %lf", &dof) == 1);
    CHECK(i ? chi2 > 1.5 * dof : chi2 < 1.2 * dof);
    char small[4] = "abc";
    FAILS(kincal_answer_json(answer, small, sizeof small, &needed, error), KINCAL_TOO_SMALL,
          "room for 4");
    CHECK(strcmp(small, "abc") == 0 && needed == strlen(json) + 1);
    free(json);
    kincal_answer_free(answer);
    answer = NULL;
    FAILS(kincal_evaluate(problem, "{\"holdout\": 3}", NULL, &answer, error), KINCAL_INPUT,
          "there is no such option; there are: noise, free");
    CHECK(answer == NULL);
    MUST(kincal_check(problem, NULL, NULL, &answer, error));
    MUST(kincal_answer_json(answer, NULL, 0, &needed, error));
    CHECK(needed > 100);
    kincal_answer_free(answer);
    kincal_problem_free(problem);
  }
}

/* ---------------------------------------------------------------------------- monitor */
/* A sample as numbers: 6 readings, ids and pixels of one view. */
typedef struct numbers {
  double readings[6];
  int32_t ids[64];
  double pixels[128];
  kincal_view view;
  kincal_sample sample;
} numbers;

static int next_sample(FILE* in, numbers* n) {
  int count = 0;
  for (int i = 0; i < 6; ++i)
    if (fscanf(in, "%lf", &n->readings[i]) != 1) return 0;
  if (fscanf(in, "%d", &count) != 1 || count > 64) exit(1);
  for (int i = 0; i < count; ++i) {
    int id = 0;
    if (fscanf(in, "%d %lf %lf", &id, &n->pixels[2 * i], &n->pixels[2 * i + 1]) != 3) exit(1);
    n->ids[i] = id;
  }
  const kincal_view view = {0, 0, n->ids, (size_t)count, n->pixels, 2 * (size_t)count, NULL, 0};
  const kincal_sample sample = {sizeof sample, sizeof view, "one", n->readings, 6, &n->view, 1};
  n->view = view;
  n->sample = sample;
  return 1;
}

static FILE* numbers_of(const char* name) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%s", folder, name);
  FILE* in = fopen(path, "r");
  if (!in) exit(1);
  return in;
}

static kincal_innovation innovation(void) {
  kincal_innovation out;
  memset(&out, 0, sizeof out);
  out.size = sizeof out;
  return out;
}

static kincal_counts counts_of(const kincal_monitor* monitor) {
  kincal_counts counts = {sizeof counts, 0, 0, 0};
  MUST(kincal_monitor_counts(monitor, &counts, error));
  return counts;
}

/* Shows the samples of a file to both, as structs and as lines; returns after how many the alarm
 * was raised. */
static int watch(kincal_monitor* by_struct, kincal_monitor* by_line, const char* name) {
  char path[64];
  snprintf(path, sizeof path, "%s.txt", name);
  FILE* in = numbers_of(path);
  snprintf(path, sizeof path, "%s.jsonl", name);
  const char* line = file(path).data;
  numbers n;
  int alarm = 0;
  for (int i = 0; next_sample(in, &n); ++i) {
    kincal_innovation a = innovation(), b = innovation();
    const char* end = strchr(line, '\n');
    const kincal_text one = {line, (size_t)(end - line), "line"};
    MUST(kincal_monitor_add(by_struct, &n.sample, &a, error));
    MUST(kincal_monitor_add_json(by_line, &one, &b, error));
    CHECK(memcmp(&a, &b, sizeof a) == 0);
    CHECK(a.sensors == 1 && a.dof > 10);
    kincal_sensor_innovation s = {sizeof s, 9, 0, 0, 0};
    MUST(kincal_monitor_sensor(by_struct, 0, &s, error));
    CHECK(s.sensor == 0 && s.dof > 10 && s.probability == a.probability);
    if (a.alarm && !alarm) alarm = i + 1;
    line = end + 1;
  }
  fclose(in);
  return alarm;
}

static void test_monitor(const kincal_result* result) {
  kincal_monitor *monitor = NULL, *other = NULL;
  const kincal_monitor_options options = {sizeof options, 1000};
  MUST(kincal_monitor_new(result, &options, &monitor, error));
  MUST(kincal_monitor_new(result, &options, &other, error));
  CHECK(strcmp(kincal_monitor_name(monitor, KINCAL_JOINTS, 5), "wrist_roll") == 0);
  size_t groups = 0, count = 9, camera = 99;
  for (; kincal_monitor_name(monitor, KINCAL_GROUPS, groups); ++groups)
    if (strcmp(kincal_monitor_name(monitor, KINCAL_GROUPS, groups), "sensor/camera/pose") == 0)
      camera = groups;
  CHECK(groups > 3 && camera < groups);
  MUST(kincal_monitor_find(monitor, &count, error));
  CHECK(count == 0);

  CHECK(watch(monitor, other, "later") == 0);
  CHECK(counts_of(monitor).samples == 24 && counts_of(monitor).outliers == 0);
  CHECK(watch(monitor, other, "moved") > 0);
  MUST(kincal_monitor_find(monitor, &count, error));
  CHECK(count == groups);
  kincal_moved moved = {sizeof moved, 0, 0, 0, 0};
  MUST(kincal_monitor_moved(monitor, 0, &moved, error));
  CHECK(moved.group == camera && moved.changes == 6 && moved.since >= 22 && moved.since <= 26 &&
        moved.probability > 0.5);
  kincal_change change;
  change.size = sizeof change;
  double square = 0; /* of its position */
  for (size_t i = 0; i < 6; ++i) {
    MUST(kincal_monitor_change(monitor, 0, i, &change, error));
    CHECK(change.sigma > 0 && change.sigma < 0.001 &&
          strcmp(change.unit, i < 3 ? "m" : "rad") == 0);
    if (i == 0) CHECK(strcmp(change.name, "sensor/camera/pose.x") == 0);
    if (i < 3) square += change.change * change.change;
  }
  CHECK(sqrt(square) > 0.001 && sqrt(square) < 0.0025); /* 2 mm of a coordinate of the increment */
  FAILS(kincal_monitor_change(monitor, 0, 6, &change, error), KINCAL_USAGE,
        "index: 6 is not below 6");
  MUST(kincal_monitor_restart(monitor, 1, error));
  FAILS(kincal_monitor_moved(monitor, 0, &moved, error), KINCAL_USAGE, "index: 0 is not below 0");
  FILE* in = numbers_of("moved.txt");
  numbers n;
  kincal_innovation after = innovation();
  CHECK(next_sample(in, &n));
  fclose(in);
  MUST(kincal_monitor_add(monitor, &n.sample, &after, error));
  CHECK(after.state == KINCAL_FITS && !after.alarm); /* it knows of the change */

  /* What it has learnt goes on in another one. */
  size_t needed = 0;
  MUST(kincal_monitor_save(monitor, NULL, 0, &needed, error));
  char* bytes = malloc(needed);
  FAILS(kincal_monitor_save(monitor, bytes, needed - 1, NULL, error), KINCAL_TOO_SMALL, "room for");
  MUST(kincal_monitor_save(monitor, bytes, needed, NULL, error));
  FAILS(kincal_monitor_load(other, bytes, needed - 1, error), KINCAL_INPUT, "it is truncated");
  bytes[needed / 2] ^= 1;
  FAILS(kincal_monitor_load(other, bytes, needed, error), KINCAL_INPUT, "its checksum is wrong");
  bytes[needed / 2] ^= 1;
  MUST(kincal_monitor_load(other, bytes, needed, error));
  free(bytes);
  CHECK(counts_of(other).samples == counts_of(monitor).samples);
  kincal_innovation again = innovation();
  MUST(kincal_monitor_add(monitor, &n.sample, &after, error));
  MUST(kincal_monitor_add(other, &n.sample, &again, error));
  CHECK(after.chi2 == again.chi2 && after.log_odds == again.log_odds);

  const kincal_counts counts = counts_of(monitor);
  CHECK(counts.noise == 1 || counts.noise > 3);
  for (size_t i = 0; i < counts.noise; ++i) {
    kincal_noise noise;
    noise.size = sizeof noise;
    MUST(kincal_monitor_noise(monitor, i, &noise, error));
    CHECK(noise.factor > 0.3 && noise.factor < 3 && noise.residuals > 0);
    CHECK(noise.sensor == 0 || (noise.sensor == -1 && noise.joint[0]));
  }
  kincal_monitor_free(other);
  kincal_monitor_free(monitor);
}

/* The camera has moved by 2 mm along an axis: a window of later samples gives its new pose. */
static void test_recalibration(const kincal_result* result) {
  enum { SAMPLES = 12 };
  kincal_monitor *monitor = NULL, *untouched = NULL;
  MUST(kincal_monitor_new(result, NULL, &monitor, error));
  MUST(kincal_monitor_new(result, NULL, &untouched, error));
  static numbers n[SAMPLES];
  kincal_sample samples[SAMPLES];
  FILE* in = numbers_of("moved.txt");
  for (int i = 0; i < SAMPLES; ++i) {
    CHECK(next_sample(in, &n[i]));
    samples[i] = n[i].sample;
  }
  fclose(in);
  const char* group = "sensor/camera/pose";
  kincal_window window;
  memset(&window, 0, sizeof window);
  window.size = sizeof window;
  window.samples = samples;
  window.sample_size = sizeof *samples;
  window.samples_count = SAMPLES;
  window.groups.names = &group;
  window.groups.count = 1;
  kincal_recalibration done = {sizeof done, 0, 0};
  MUST(kincal_monitor_recalibrate(monitor, &window, &done, error));
  CHECK(done.samples == SAMPLES && done.components > 10);
  kincal_recalibrated c, x[100];
  c.size = sizeof c;
  double square = 0, variance = 0;
  int of_camera = 0;
  CHECK(done.components <= 100);
  for (size_t i = 0; i < done.components && i < 100; ++i) {
    MUST(kincal_monitor_recalibrated(monitor, i, &c, error));
    x[i] = c;
    CHECK(c.determined == 1 && c.sigma >= 0);
    if (strncmp(c.name, "sensor/camera/pose.", 19) == 0) {
      ++of_camera;
      CHECK(c.value == c.change && strcmp(c.unit, strchr("xyz", c.name[19]) ? "m" : "rad") == 0);
      if (strchr("xyz", c.name[19])) square += c.change * c.change, variance += c.sigma * c.sigma;
    }
  }
  CHECK(of_camera == 6 && fabs(sqrt(square) - 0.002) < 3 * sqrt(variance) && variance < 1e-7);

  /* The same by lines. */
  const char* const text = file("moved.jsonl").data;
  const char* end = text;
  for (int i = 0; i < SAMPLES; ++i) end = strchr(end, '\n') + 1;
  const kincal_text lines = {text, (size_t)(end - text), "lines"};
  kincal_window by_lines = window;
  by_lines.samples = NULL;
  by_lines.lines = &lines;
  MUST(kincal_monitor_recalibrate(monitor, &by_lines, &done, error));
  for (size_t i = 0; i < done.components && i < 100; ++i) {
    MUST(kincal_monitor_recalibrated(monitor, i, &c, error));
    CHECK(c.value == x[i].value && c.sigma == x[i].sigma && strcmp(c.name, x[i].name) == 0);
  }
  /* One picture does not determine the camera and a joint of the arm that holds it. */
  const char* const two[2] = {"joint/turn/offset", "target/board/pose"};
  const kincal_names both = {two, 2};
  kincal_window little = window;
  little.samples_count = 1;
  little.groups = both;
  MUST(kincal_monitor_recalibrate(monitor, &little, &done, error));
  int open = 0;
  for (size_t i = 0; i < done.components && i < 100; ++i) {
    MUST(kincal_monitor_recalibrated(monitor, i, &c, error));
    open += !c.determined;
  }
  CHECK(done.samples == 1 && open > 0);

  /* What is wrong is refused; the last recalibration stays, and so does what was learned. */
  kincal_window wrong = window;
  group = "sensor/camra/pose";
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_INPUT,
        "no group 'sensor/camra/pose'; nearest: sensor/camera/pose");
  CHECK(strcmp(error->name, "groups") == 0);
  group = "sensor/camera/pose";
  wrong.groups.count = 0;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_INPUT,
        "groups: at least one");
  wrong = window;
  wrong.samples_count = 0;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_INPUT,
        "samples: at least one");
  wrong = window;
  wrong.sample_size = 8;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_USAGE, "sample_size: 8");
  wrong = window;
  wrong.lines = &lines;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_USAGE, "lines, too");
  wrong = window;
  wrong.iterations = -1;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_INPUT,
        "iterations: -1 is not in");
  wrong = window;
  wrong.size = 16;
  FAILS(kincal_monitor_recalibrate(monitor, &wrong, &done, error), KINCAL_USAGE,
        "window: its size is 16");
  n[3].readings[2] = NAN;
  FAILS(kincal_monitor_recalibrate(monitor, &window, &done, error), KINCAL_INPUT,
        "'bend' has none");
  CHECK(strcmp(error->name, "samples[3].readings") == 0);
  n[3].readings[2] = 0;
  n[5].pixels[1] = INFINITY;
  FAILS(kincal_monitor_recalibrate(monitor, &window, &done, error), KINCAL_INPUT, "not finite");
  CHECK(strcmp(error->name, "samples[5].views[0].z") == 0);
  n[5].pixels[1] = 0;
  samples[7].size = 8;
  FAILS(kincal_monitor_recalibrate(monitor, &window, &done, error), KINCAL_USAGE,
        "samples[7]: its size is 8");
  kincal_recalibrated kept_one;
  kept_one.size = sizeof kept_one;
  MUST(kincal_monitor_recalibrated(monitor, done.components - 1, &kept_one, error));
  CHECK(kept_one.value == c.value && kept_one.sigma == c.sigma);
  FAILS(kincal_monitor_recalibrated(untouched, 0, &c, error), KINCAL_USAGE, "is not below 0");
  CHECK(watch(monitor, untouched, "later") == 0);
  kincal_monitor_free(untouched);
  kincal_monitor_free(monitor);
}

/* Samples of prepared forms allocate nothing, and the monitor says the same as another one. */
static void test_prepared(const kincal_result* result) {
  enum { SAMPLES = 24 };
  kincal_monitor *monitor = NULL, *other = NULL;
  MUST(kincal_monitor_new(result, NULL, &monitor, error));
  MUST(kincal_monitor_new(result, NULL, &other, error));
  static numbers n[SAMPLES];
  FILE* in = numbers_of("later.txt");
  for (int i = 0; i < SAMPLES; ++i) {
    CHECK(next_sample(in, &n[i]));
    MUST(kincal_monitor_prepare(monitor, &n[i].sample, error));
  }
  fclose(in);
  CHECK(counts_of(monitor).samples == 0 && counts_of(monitor).noise == 0);
  kincal_innovation a = innovation(), b = innovation();
  for (int i = 0; i < SAMPLES; ++i) {
    counting = i > 0; /* the first one makes room for the list of sensors */
    CHECK(kincal_monitor_add(monitor, &n[i].sample, &a, NULL) == KINCAL_OK);
    counting = 0;
    MUST(kincal_monitor_add(other, &n[i].sample, &b, error));
    CHECK(memcmp(&a, &b, sizeof a) == 0);
  }
  CHECK(allocations == 0);
  n[0].ids[0] = -1;
  FAILS(kincal_monitor_prepare(monitor, &n[0].sample, error), KINCAL_INPUT, "no point -1");
  CHECK(strcmp(error->name, "views[0].ids") == 0);
  size_t bytes = 0;
  MUST(kincal_monitor_memory(result, &bytes, error));
  CHECK(bytes > 1000000 && bytes < 4000000);
  FAILS(kincal_monitor_memory(result, NULL, error), KINCAL_USAGE, "bytes: is NULL");
  kincal_monitor_free(other);
  kincal_monitor_free(monitor);
}

/* A board whose picture moves by 3 px, with a little noise that repeats. */
static void test_static_view(void) {
  enum { POINTS = 20 };
  kincal_static_view* view = NULL;
  const kincal_static_options few = {sizeof few, 10000, 2, 0};
  FAILS(kincal_static_view_new(POINTS, &few, &view, error), KINCAL_INPUT, "at least 3 samples");
  FAILS(kincal_static_view_new(0, NULL, &view, error), KINCAL_INPUT, "at least 1 is expected");
  MUST(kincal_static_view_new(POINTS, NULL, &view, error));
  int32_t points[POINTS];
  double pixels[2 * POINTS];
  kincal_static_innovation told;
  told.size = sizeof told;
  for (int n = 0; n < 40; ++n) {
    for (int i = 0; i < POINTS; ++i) {
      points[i] = i;
      pixels[2 * i] = 100 * (i % 5) + 0.1 * sin(12.9 * i + 78.2 * n) + (n < 30 ? 0 : 3);
      pixels[2 * i + 1] = 100 * (i / 5) + 0.1 * sin(93.9 * i + 67.3 * n);
    }
    MUST(kincal_static_view_add(view, points, pixels, POINTS, &told, error));
    CHECK(told.learning == (n < 10) && told.alarm == (n >= 30));
  }
  kincal_static_moved moved;
  moved.size = sizeof moved;
  MUST(kincal_static_view_moved(view, 0, &moved, error));
  CHECK(moved.point == -1 && moved.since == 30 && moved.probability > 0.9);
  CHECK(fabs(moved.shift[0] - 3) < 0.1 && fabs(moved.shift[1]) < 0.1);
  FAILS(kincal_static_view_moved(view, POINTS + 1, &moved, error), KINCAL_USAGE, "is not below 21");
  points[1] = 0;
  FAILS(kincal_static_view_add(view, points, pixels, POINTS, &told, error), KINCAL_INPUT,
        "one is there twice");
  points[1] = POINTS;
  FAILS(kincal_static_view_add(view, points, pixels, POINTS, &told, error), KINCAL_INPUT,
        "there is no such point");
  FAILS(kincal_static_view_add(view, points, NULL, POINTS, &told, error), KINCAL_USAGE, "pixels");
  MUST(kincal_static_view_restart(view, error));
  points[1] = 1;
  MUST(kincal_static_view_add(view, points, pixels, POINTS, &told, error));
  CHECK(told.learning == 1);
  kincal_static_view_free(view);
}

static void test_wrong_samples(const kincal_result* result) {
  kincal_monitor *monitor = NULL, *fresh = NULL;
  kincal_monitor_options few = {sizeof few, 5};
  FAILS(kincal_monitor_new(result, &few, &monitor, error), KINCAL_INPUT,
        "a number from 10 on is expected");
  CHECK(strcmp(error->name, "samples_between_alarms") == 0 && monitor == NULL);
  MUST(kincal_monitor_new(result, NULL, &monitor, error));
  FILE* in = numbers_of("later.txt");
  numbers n;
  CHECK(next_sample(in, &n));
  kincal_innovation got = innovation();
#define REFUSED(what, place, text)                                                            \
  do {                                                                                        \
    rewind(in);                                                                               \
    CHECK(next_sample(in, &n));                                                               \
    what;                                                                                     \
    FAILS(kincal_monitor_add(monitor, &n.sample, &got, error), KINCAL_INPUT, text);           \
    if (strcmp(error->name, place) != 0)                                                      \
      ++failures, printf("%s:%d: '%s' is no '%s'\n", __FILE__, __LINE__, error->name, place); \
  } while (0)
  REFUSED(n.sample.readings_count = 5, "readings", "6 are expected, one a joint, not 5");
  REFUSED(n.readings[3] = NAN, "readings", "'forearm_roll' has none");
  REFUSED(n.readings[3] = INFINITY, "readings", "that of 'forearm_roll' is infinite");
  REFUSED(n.view.sensor = 1, "views[0].sensor", "no sensor 1");
  REFUSED(n.view.target = -1, "views[0].target", "no target -1");
  REFUSED(n.ids[2] = 35, "views[0].ids", "'board' has no point 35");
  REFUSED(n.ids[2] = n.ids[1], "views[0].ids", "occurs twice");
  REFUSED(n.view.ids_count = 0, "views[0].ids", "at least one point");
  REFUSED(--n.view.z_count, "views[0].z", "numbers are expected");
  REFUSED(n.pixels[5] = NAN, "views[0].z", "not finite");
  double sigma[2] = {0.1, -0.1};
  REFUSED((n.view.sigma = sigma, n.view.sigma_count = 2), "views[0].sigma", "positive");
  REFUSED((n.view.sigma = sigma, n.view.sigma_count = 1), "views[0].sigma",
          "2 numbers are expected");
#undef REFUSED
  rewind(in);
  CHECK(next_sample(in, &n));
  n.view.ids = NULL;
  FAILS(kincal_monitor_add(monitor, &n.sample, &got, error), KINCAL_USAGE, "views[0].ids: is NULL");
  n.sample.views = NULL;
  FAILS(kincal_monitor_add(monitor, &n.sample, &got, error), KINCAL_USAGE, "views: is NULL");
  n.sample.view_size = 8;
  FAILS(kincal_monitor_add(monitor, &n.sample, &got, error), KINCAL_USAGE,
        "not the size of a view");
  n.sample.size = 8;
  FAILS(kincal_monitor_add(monitor, &n.sample, &got, error), KINCAL_USAGE, "sample: its size is 8");
  const kincal_text lines[] = {text_of("", "line"),
                               text_of("{\"id\": \"a\", \"joints\": {}, \"views\": [{\"sensor\": "
                                       "\"eye\", \"target\": \"board\"}]}",
                                       "line"),
                               text_of("{\"id\": \"a\", \"joints\": {}, \"views\": []}\n{\"id\": "
                                       "\"b\", \"joints\": {}, \"views\": []}\n",
                                       "line")};
  FAILS(kincal_monitor_add_json(monitor, &lines[0], &got, error), KINCAL_INPUT, "line");
  FAILS(kincal_monitor_add_json(monitor, &lines[1], &got, error), KINCAL_INPUT,
        "unknown sensor 'eye'");
  CHECK(strcmp(error->file, "line") == 0 && error->line == 1 &&
        strcmp(error->name, "views[0].sensor") == 0);
  FAILS(kincal_monitor_add_json(monitor, &lines[2], &got, error), KINCAL_INPUT,
        "one sample is expected, not 2");
  FAILS(kincal_monitor_sensor(monitor, 0, NULL, error), KINCAL_USAGE, "sensor: is NULL");

  /* After all that it says what one says that was never shown anything wrong. */
  CHECK(counts_of(monitor).samples == 0 && counts_of(monitor).noise == 0);
  MUST(kincal_monitor_new(result, NULL, &fresh, error));
  rewind(in);
  while (next_sample(in, &n)) {
    kincal_innovation a = innovation(), b = innovation();
    MUST(kincal_monitor_add(monitor, &n.sample, &a, error));
    MUST(kincal_monitor_add(fresh, &n.sample, &b, error));
    CHECK(memcmp(&a, &b, sizeof a) == 0);
  }
  fclose(in);
  kincal_monitor_free(fresh);
  kincal_monitor_free(monitor);
}

/* ---------------------------------------------------------------------------- wrong input */
static char* replaced(const char* text, const char* what, const char* by) {
  const char* at = strstr(text, what);
  if (!at) exit(1);
  char* out = keep(calloc(strlen(text) + strlen(by) + 1, 1));
  memcpy(out, text, (size_t)(at - text));
  strcat(strcat(out, by), at + strlen(what));
  return out;
}

static void test_wrong_problems(void) {
  const kincal_text rig = file("rig.yaml"), urdf = file("robot.urdf"),
                    samples = file("samples.jsonl");
  kincal_problem* problem = NULL;
  kincal_text wrong = text_of(replaced(rig.data, "type: camera", "type: camra"), "my/rig.yaml");
  FAILS(kincal_problem_new(&wrong, &urdf, &samples, &problem, error), KINCAL_INPUT, "camra");
  CHECK(strcmp(error->file, "my/rig.yaml") == 0 && error->line > 15 &&
        strcmp(error->name, "sensors.camera.type") == 0);
  wrong = text_of(replaced(rig.data, "link: flange", "link: flang"), NULL);
  FAILS(kincal_problem_new(&wrong, &urdf, &samples, &problem, error), KINCAL_INPUT, "flang");
  CHECK(strcmp(error->file, "rig.yaml") == 0);
  FAILS(kincal_problem_new(&rig, NULL, &samples, &problem, error), KINCAL_INPUT,
        "the text of this URDF is needed");
  CHECK(error->line == 2 && strcmp(error->name, "robot") == 0);
  wrong = text_of(replaced(urdf.data, "</joint>", "</joynt>"), "arm.urdf");
  FAILS(kincal_problem_new(&rig, &wrong, &samples, &problem, error), KINCAL_INPUT, "arm.urdf");
  CHECK(strcmp(error->file, "arm.urdf") == 0 && error->line > 1);
  /* samples of another rig */
  wrong = text_of(replaced(samples.data, "\"camera\"", "\"left_camera\""), "log.jsonl");
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_INPUT,
        "unknown sensor 'left_camera'; nearest: camera");
  CHECK(strcmp(error->file, "log.jsonl") == 0 && error->line == 1 &&
        strcmp(error->name, "views[0].sensor") == 0);
  wrong = text_of(replaced(samples.data, "\"bend\":", "\"elbow\":"), "log.jsonl");
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_INPUT,
        "needs joint 'bend'");
  wrong = text_of(replaced(samples.data, "\"ids\": [0, 1,", "\"ids\": [0, 99,"), "log.jsonl");
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_INPUT, "99");
  CHECK(error->line == 1);
  wrong =
      text_of(replaced(samples.data, "\"pixels\": [[", "\"pixels\": [[NaN, 1], ["), "log.jsonl");
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_INPUT, "log.jsonl:1");
  wrong = samples;
  wrong.size = 500;
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_INPUT, "samples.jsonl:1");
  wrong.data = NULL;
  FAILS(kincal_problem_new(&rig, &urdf, &wrong, &problem, error), KINCAL_USAGE, "samples: is NULL");
  FAILS(kincal_problem_new(NULL, &urdf, &samples, &problem, error), KINCAL_USAGE, "rig: is NULL");
  FAILS(kincal_problem_new(&rig, &urdf, &samples, NULL, error), KINCAL_USAGE, "problem: is NULL");
  CHECK(problem == NULL);
  CHECK(kincal_problem_new(NULL, &urdf, &samples, &problem, NULL) ==
        KINCAL_USAGE); /* nobody listens */
  kincal_problem_free(NULL);
  kincal_result_free(NULL);
  kincal_answer_free(NULL);
  kincal_monitor_free(NULL);
  CHECK(kincal_problem_samples(NULL) == 0 && kincal_problem_name(NULL, 0, 0) == NULL &&
        kincal_result_file_name(NULL, 0) == NULL);
}

static void test_wrong_settings(const kincal_problem* problem, const char* expected) {
  kincal_result* result = NULL;
  const struct {
    const char *settings, *name, *text;
  } wrong[] = {{"{\"nose\": \"point\"}", "nose", "there is no such option; nearest: noise"},
               {"{\"noise\": \"pink\"}", "noise", "unknown value 'pink'; valid: "},
               {"{\"noise\": 3}", "noise", "a text is expected"},
               {"{\"free\": [1]}", "free", "a list of names is expected"},
               {"{\"free\": {\"a\": 1}}", "free", "a list of names is expected"},
               {"{\"free\": \"joint/elbow/offset\"}", "free", "joint/elbow/offset"},
               {"{\"group\": [\"offset\"]}", "group", "offsets"},
               {"{\"threads\": 0}", "threads", "0 is not in 1 .. 1024"},
               {"{\"threads\": 1.5}", "threads", "an integer is expected"},
               {"{\"iterations\": 99999999999}", "iterations", "99999999999"},
               {"{\"reject\": \"yes\"}", "reject", "true or false is expected"},
               {"{\"report_frame\": [\"flang\"]}", "report_frame", "nearest: flange"},
               {"{\"require\": \"frame/flange<1px\"}", "require", "px"},
               {"[]", "", "settings:1: a mapping of options"},
               {"{\"noise\": \"point\"", "", "settings:1"},
               {"", "", "settings"}};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
    FAILS(kincal_calibrate(problem, wrong[i].settings, NULL, &result, error), KINCAL_INPUT,
          wrong[i].text);
    if (strcmp(error->name, wrong[i].name) != 0)
      ++failures,
          printf("%s: name '%s', message %s\n", wrong[i].settings, error->name, error->message);
  }
  int news = 0;
  const kincal_progress progress = {sizeof progress, cancel, &news}, small = {8, cancel, &news};
  FAILS(kincal_calibrate(problem, NULL, &progress, &result, error), KINCAL_CANCELLED,
        "the listener");
  CHECK(news == 4);
  FAILS(kincal_calibrate(problem, NULL, &small, &result, error), KINCAL_USAGE,
        "progress: its size is 8");
  FAILS(kincal_calibrate(NULL, NULL, NULL, &result, error), KINCAL_USAGE, "problem: is NULL");
  CHECK(result == NULL);
  MUST(kincal_calibrate(problem, NULL, NULL, &result, error)); /* as before */
  char* csv = result_file(result, "covariance.csv");
  CHECK(strcmp(csv, expected) == 0);
  free(csv);
  kincal_result_free(result);
}

/* A board behind its camera: nothing can start. */
static void test_no_start(void) {
  const kincal_text rig = file("behind.yaml"), urdf = file("behind.urdf"),
                    samples = file("behind.jsonl");
  kincal_problem* problem = NULL;
  kincal_result* result = NULL;
  MUST(kincal_problem_new(&rig, &urdf, &samples, &problem, error));
  FAILS(kincal_calibrate(problem, NULL, NULL, &result, error), KINCAL_NUMERICAL,
        "no calibration can start");
  CHECK(result == NULL);
  kincal_problem_free(problem);
}

static void test_sizes(const kincal_result* result) {
  struct {
    kincal_summary summary;
    unsigned char behind[64];
  } newer;
  memset(&newer, 0x55, sizeof newer);
  newer.summary.size = sizeof newer; /* a header of a later version */
  MUST(kincal_result_summary(result, &newer.summary, error));
  CHECK(newer.summary.size == sizeof newer && strcmp(newer.summary.use, "good") == 0);
  for (size_t i = 0; i < sizeof newer.behind; ++i) CHECK(newer.behind[i] == 0x55);
  kincal_summary older;
  memset(&older, 0x55, sizeof older);
  older.size = 16;
  FAILS(kincal_result_summary(result, &older, error), KINCAL_USAGE, "summary: its size is 16");
  CHECK(older.dof == 0x5555555555555555);
  kincal_error small;
  memset(&small, 0x55, sizeof small);
  small.size = 16;
  CHECK(kincal_result_summary(NULL, &older, &small) == KINCAL_USAGE && small.status == 0x55555555);
  kincal_component component;
  component.size = sizeof component;
  FAILS(kincal_result_component(result, 100000, &component, error), KINCAL_USAGE,
        "index: 100000 is not below");
  char buffer[8] = "1234567";
  size_t needed = 0;
  FAILS(kincal_result_file(result, "result.json", buffer, sizeof buffer, &needed, error),
        KINCAL_TOO_SMALL, "room for 8");
  CHECK(strcmp(buffer, "1234567") == 0 && needed > 1000);
  FAILS(kincal_result_file(result, "result.jsn", NULL, 0, &needed, error), KINCAL_INPUT,
        "no file 'result.jsn'; nearest: result.json");
  FAILS(kincal_result_file(result, NULL, NULL, 0, NULL, error), KINCAL_USAGE, "name: is NULL");
  FAILS(kincal_result_file(result, "rig.yaml", NULL, 1 << 20, &needed, error), KINCAL_USAGE,
        "buffer: is NULL");
  double few[2] = {1, 2};
  FAILS(kincal_result_covariance(result, few, 2, &needed, error), KINCAL_TOO_SMALL, "room for 2");
  CHECK(few[0] == 1 && few[1] == 2);
  CHECK(strcmp(kincal_version(), "0.1.0") >= 0);
}

/* ---------------------------------------------------------------------------- threads */
typedef struct shared {
  const kincal_problem* problem;
  const kincal_result* result;
  const char* expected;
  int wrong;
} shared;

static void* work(void* of) {
  shared* s = of;
  for (int i = 0; i < 3; ++i) {
    kincal_result* result = NULL;
    kincal_monitor* monitor = NULL;
    double readings[6] = {0.1, -0.2, 0.3, 0.4, -0.5, 0.6}, pose[16];
    s->wrong += kincal_calibrate(s->problem, NULL, NULL, &result, NULL) != KINCAL_OK;
    s->wrong += kincal_calibrate(s->problem, "{\"nose\": 1}", NULL, &result, NULL) != KINCAL_INPUT;
    s->wrong += kincal_result_forward(s->result, readings, 6, "sensor/camera", NULL, pose, NULL) !=
                KINCAL_OK;
    s->wrong += kincal_monitor_new(s->result, NULL, &monitor, NULL) != KINCAL_OK;
    char* csv = result_file(result, "covariance.csv");
    s->wrong += strcmp(csv, s->expected) != 0;
    free(csv);
    kincal_monitor_free(monitor);
    kincal_result_free(result);
  }
  return NULL;
}

static void test_threads(const kincal_problem* problem, const kincal_result* result,
                         const char* expected) {
  pthread_t threads[3];
  shared of[3];
  for (int i = 0; i < 3; ++i) {
    const shared one = {problem, result, expected, 0};
    of[i] = one;
    if (pthread_create(&threads[i], NULL, work, &of[i]) != 0) exit(1);
  }
  for (int i = 0; i < 3; ++i) {
    pthread_join(threads[i], NULL);
    CHECK(of[i].wrong == 0);
  }
}

int main(int argc, char** argv) {
  if (argc != 2) return 1;
  folder = argv[1];
  kincal_problem* problem = arm();
  kincal_result* result = calibrated(problem);
  char* covariance = result_file(result, "covariance.csv");
  test_result(problem, result);
  test_read_back(result);
  test_covariance_of(result);
  test_residuals(problem, result);
  test_plans(problem, result);
  test_forward(result);
  test_evaluation(result);
  test_monitor(result);
  test_recalibration(result);
  test_prepared(result);
  test_static_view();
  test_wrong_samples(result);
  test_wrong_problems();
  test_wrong_settings(problem, covariance);
  test_no_start();
  test_sizes(result);
  test_threads(problem, result, covariance);
  free(covariance);
  kincal_problem_free(problem); /* the result stands alone */
  CHECK(strcmp(summary_of(result).use, "good") == 0);
  kincal_result_free(result);
  for (int i = 0; i < 64; ++i) free(kept[i]);
  printf("%d failures\n", failures);
  return failures ? 1 : 0;
}
