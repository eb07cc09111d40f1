/* kincal in C99: calibrates robots from texts in memory, and reads, evaluates and monitors results.
 * docs/c.md shows the use, by tasks; docs/formats.md has the formats, docs/reference.md the
 * options.
 *
 * Handles are opaque. A function that creates a handle writes it only on success. Release it with
 * the ..._free() of its type, which accepts NULL. A call that fails changes neither its handles nor
 * its outputs (except `needed`).
 *
 * Functions return KINCAL_OK or a kind of error, and fill in `error` if it is not NULL. They throw,
 * print and write no files, and there is no state outside the handles. One file may be read: if the
 * name of a rig with priors is a path, the intrinsics.json beside it decides whether its lenses
 * come from the same samples.
 *
 * Structs begin with their size, which the caller sets to sizeof. Later versions append members, so
 * programs need not be compiled again. A struct smaller than in this first version is neither read
 * nor written: KINCAL_USAGE.
 *
 * Texts are UTF-8 and end with a 0; texts of files have a length instead. A returned `const char*`
 * is valid as long as the handle. Buffers: `needed` (may be NULL) receives the number of bytes or
 * values. With a NULL buffer of size 0 nothing else happens; a buffer that is too small is not
 * written: KINCAL_TOO_SMALL.
 *
 * Units are m, rad and px; frames and names are those of the rig's files.
 *
 * Threads. [any]: any thread may call at any time. [shared]: several threads may use one handle at
 * once while none frees it. [one]: one thread at a time may use a handle. Different handles are
 * independent. */
#ifndef KINCAL_H
#define KINCAL_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define KINCAL_API __attribute__((visibility("default")))
#else
#define KINCAL_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* How a call ended. */
typedef int32_t kincal_status;
enum {
  KINCAL_OK = 0,
  KINCAL_INPUT = 1,     /* an argument is wrong: a text, a name, a number, an option */
  KINCAL_USAGE = 2,     /* the call is wrong: NULL, the size of a struct, an index */
  KINCAL_TOO_SMALL = 3, /* the buffer is; `needed` has the required size */
  KINCAL_NUMERICAL = 4, /* no calibration can start, or its result cannot be written exactly */
  KINCAL_CANCELLED = 5, /* the listener requested it */
  KINCAL_MEMORY = 6,
  KINCAL_INTERNAL = 7 /* a mistake of kincal */
};

/* The error, and its place if it is known: the name of the text and the line in it, and the name of
 * the field ("views[0].ids"), option ("free") or argument. Longer texts are truncated. */
typedef struct kincal_error {
  size_t size;
  kincal_status status;
  int32_t line; /* from 1; 0: unknown */
  char message[2048];
  char file[512];
  char name[256];
} kincal_error;
#define KINCAL_ERROR_INIT                       \
  {                                             \
    sizeof(kincal_error), 0, 0, {0}, {0}, { 0 } \
  }

/* The text of a file: `size` bytes, and its name in messages. */
typedef struct kincal_text {
  const char* data;
  size_t size;
  const char* name;
} kincal_text;
/* A list of names. */
typedef struct kincal_names {
  const char* const* names;
  size_t count;
} kincal_names;

/* The version of the library, "0.1.0". [any] */
KINCAL_API const char* kincal_version(void);

/* ---------------------------------------------------------------------------- problems
 * A problem is a rig, its robot, and samples, read and checked. */
typedef struct kincal_problem kincal_problem;

/* Reads a rig.yaml, a URDF (NULL: the rig's robot reports only flange poses) and a samples.jsonl
 * (NULL: there are none; the problem is then for planning only). [any] */
KINCAL_API kincal_status kincal_problem_new(const kincal_text* rig, const kincal_text* urdf,
                                            const kincal_text* samples, kincal_problem** problem,
                                            kincal_error* error);
/* [one] */
KINCAL_API void kincal_problem_free(kincal_problem* problem);
/* The number of samples; 0 of NULL. [shared] */
KINCAL_API size_t kincal_problem_samples(const kincal_problem* problem);

/* Kinds of names. */
enum {
  KINCAL_JOINTS = 0,  /* that have a reading, in the order in which postures are given */
  KINCAL_SENSORS = 1, /* of the rig, in its order: indices in views */
  KINCAL_TARGETS = 2,
  KINCAL_FRAMES = 3, /* links, sensor/NAME, target/NAME */
  KINCAL_GROUPS = 4, /* groups that move together; of monitors only */
  KINCAL_SAMPLES = 5 /* ids, of problems and results: indices in residuals */
};
/* The name of a kind and index; NULL beyond the last one, and of other kinds. [shared] */
KINCAL_API const char* kincal_problem_name(const kincal_problem* problem, int32_t kind,
                                           size_t index);

/* ---------------------------------------------------------------------------- calibration */
/* The progress of the work. */
typedef struct kincal_news {
  size_t size;
  const char* what;  /* the stage, or the step; it lives until the listener returns */
  double share;      /* completed share of the stage; NaN: unknown */
  double chi2;       /* after that iteration, else NaN */
  int32_t iteration; /* that ended; 0: a step begins; -1: it is a stage */
  int32_t reserved;
} kincal_news;
/* Called by one thread at a time, possibly not the caller's. It returns 0, or any other value to
 * cancel the work: KINCAL_CANCELLED. It must not throw, nor leave by longjmp. */
typedef int32_t (*kincal_listener)(const kincal_news* news, void* user);
typedef struct kincal_progress {
  size_t size;
  kincal_listener listener;
  void* user;
} kincal_progress;

/* A result is a calibration: the texts of its files, and their contents. */
typedef struct kincal_result kincal_result;

/* Calibrates as `kincal calibrate` and kincal.calibrate() in Python do, with their options:
 * `settings` is a JSON mapping, "{\"noise\": \"point\", \"free\": [\"joint/NAME/offset\"]}", or
 * NULL. A bad result is not an error: see kincal_result_summary(). `progress` may be NULL.
 * [shared] */
KINCAL_API kincal_status kincal_calibrate(const kincal_problem* problem, const char* settings,
                                          const kincal_progress* progress, kincal_result** result,
                                          kincal_error* error);
/* Reads a result from texts of its folder, by their names there: rig.yaml, result.json, robot.urdf,
 * robot_unbent.urdf and rig_rigid.yaml where they are, covariance.csv (for covariance and monitor).
 * Others are kept. [any] */
KINCAL_API kincal_status kincal_result_read(const kincal_text* files, size_t count,
                                            kincal_result** result, kincal_error* error);
/* [one] */
KINCAL_API void kincal_result_free(kincal_result* result);

/* How a calibration ended. */
typedef struct kincal_summary {
  size_t size;
  double chi2; /* NaN: there is none */
  int64_t dof;
  size_t components; /* estimated */
  size_t rows;       /* of the covariance; 0: there is none */
  char status[32];   /* converged, unobservable, not_converged, unexplained */
  char use[16];      /* whether to use it: good, doubts, no */
} kincal_summary;
/* [shared] */
KINCAL_API kincal_status kincal_result_summary(const kincal_result* result, kincal_summary* summary,
                                               kincal_error* error);

/* The name of an existing file of the result, by index; NULL beyond the last one. [shared] */
KINCAL_API const char* kincal_result_file_name(const kincal_result* result, size_t index);
/* The text of a file, as `kincal calibrate --out` writes it, with a final 0, which counts in
 * `size` and `needed`. report.html is created by each call. [shared] */
KINCAL_API kincal_status kincal_result_file(const kincal_result* result, const char* name,
                                            char* buffer, size_t size, size_t* needed,
                                            kincal_error* error);

/* An estimated component. Those of poses are increments [x y z rx ry rz] from the rig's pose.
 */
typedef struct kincal_component {
  size_t size;
  double initial, value;
  double sigma; /* NaN: not determined; 0: fixed */
  int64_t row;  /* of the covariance; -1: none */
  char name[256];
  char unit[16];
} kincal_component;
/* [shared] */
KINCAL_API kincal_status kincal_result_component(const kincal_result* result, size_t index,
                                                 kincal_component* component, kincal_error* error);
/* The covariance, rows x rows values row by row; NaN: not determined. Some rows may belong to fixed
 * parameters without a component. [shared] */
KINCAL_API kincal_status kincal_result_covariance(const kincal_result* result, double* buffer,
                                                  size_t count, size_t* needed,
                                                  kincal_error* error);
/* The same of named components only, in this order: n x n values, row by row. A parameter stands
 * for all of its components. 0: fixed. KINCAL_INPUT if a name is unknown or was not estimated, or
 * the result has no covariance. [shared] */
KINCAL_API kincal_status kincal_result_covariance_of(const kincal_result* result,
                                                     const kincal_names* names, double* buffer,
                                                     size_t count, size_t* needed,
                                                     kincal_error* error);

/* What is left of the measurement of a point, or of a pose. */
typedef struct kincal_residual {
  size_t size;
  int64_t sample;         /* of KINCAL_SAMPLES */
  int32_t sensor, target; /* of KINCAL_SENSORS and KINCAL_TARGETS */
  int64_t point;          /* of the target; -1: a pose */
  int32_t held_out;       /* 1: not used by the calibration */
  int32_t count;          /* of `value`; as many of `before`, at most 3 */
  double value[6];        /* px, m or rad as in residuals.csv; those beyond `count` are 0 */
  double before[3];       /* with the rig's values; NaN: unknown */
  double whitened;        /* length over the noise, sigmas */
} kincal_residual;
/* All residuals, in the order of residuals.csv. `count` structs of `residual_size` bytes, which is
 * sizeof(kincal_residual), have room in the buffer; `needed` receives their number. KINCAL_INPUT if
 * the result has no residuals.csv or samples.csv (no_report). [shared] */
KINCAL_API kincal_status kincal_result_residuals(const kincal_result* result,
                                                 kincal_residual* buffer, size_t residual_size,
                                                 size_t count, size_t* needed, kincal_error* error);

/* As kincal_problem_name(). [shared] */
KINCAL_API const char* kincal_result_name(const kincal_result* result, int32_t kind, size_t index);
/* The pose of a frame relative to `base` (NULL: the rig's base), for the calibrated robot including
 * bending: a 4 x 4 matrix, row by row. `readings` are in the order of KINCAL_JOINTS; NaN: unknown,
 * for a joint that moves neither. [shared] (7 parameters because C has no spans.) */
KINCAL_API kincal_status kincal_result_forward(const kincal_result* result, const double* readings,
                                               size_t count, const char* frame, const char* base,
                                               double pose[16], kincal_error* error);

/* Readings that move a robot that bends, or has error curves, to the pose that robot.urdf has at
 * `planned`. */
typedef struct kincal_compensation {
  size_t size;
  const char* tip;       /* the frame that must reach the pose */
  const char* base;      /* a stationary reference frame; NULL: the only such sensor or target */
  const double* planned; /* in the order of KINCAL_JOINTS; NaN: unknown */
  double* readings;      /* receives the result; may be `planned` */
  size_t count;          /* of both */
  double position, rotation; /* receive the remaining errors, m and rad */
  int32_t position_only;     /* not 0: ignore the orientation of the tip */
  int32_t reserved;
} kincal_compensation;
/* KINCAL_INPUT if robot.urdf has the whole calibration. [shared] */
KINCAL_API kincal_status kincal_result_compensate(const kincal_result* result,
                                                  kincal_compensation* compensation,
                                                  kincal_error* error);
/* The same at a temperature of the robot (degrees Celsius), which joints may depend on. [shared] */
KINCAL_API kincal_status kincal_result_compensate_at(const kincal_result* result,
                                                     double temperature,
                                                     kincal_compensation* compensation,
                                                     kincal_error* error);

/* A problem of the calibrated rig with other samples, for an evaluation. [shared] */
KINCAL_API kincal_status kincal_result_problem(const kincal_result* result,
                                               const kincal_text* samples, kincal_problem** problem,
                                               kincal_error* error);

/* ---------------------------------------------------------------------------- evaluation, plans
 * An answer is a result without a calibration, as JSON, for some with other texts. */
typedef struct kincal_answer kincal_answer;

/* Residuals at the rig's own values, as `kincal evaluate --json`. Options: noise, free. [shared] */
KINCAL_API kincal_status kincal_evaluate(const kincal_problem* problem, const char* settings,
                                         const kincal_progress* progress, kincal_answer** answer,
                                         kincal_error* error);
/* Looks for the usual mistakes, as `kincal check --json`. Options: noise, threads. [shared] */
KINCAL_API kincal_status kincal_check(const kincal_problem* problem, const char* settings,
                                      const kincal_progress* progress, kincal_answer** answer,
                                      kincal_error* error);
/* Plans the next postures, as `kincal plan --json`. Options: next, candidates, seed, goal, postures
 * (the text of such a file), clearance (m; null: links are not checked). The samples of the problem
 * count as recorded. Text: postures.jsonl. [shared] */
KINCAL_API kincal_status kincal_plan(const kincal_problem* problem, const char* settings,
                                     const kincal_progress* progress, kincal_answer** answer,
                                     kincal_error* error);
/* Plans the test poses of ISO 9283, as `kincal plan --verify --json`. Options: sensor, cycles,
 * approaches, region (6 numbers), candidates, seed, clearance. Text: postures.jsonl. [shared] */
KINCAL_API kincal_status kincal_plan_verification(const kincal_problem* problem,
                                                  const char* settings,
                                                  const kincal_progress* progress,
                                                  kincal_answer** answer, kincal_error* error);
/* Verifies a calibration by samples that it has not seen, as `kincal verify`; the JSON is that of
 * certificate.json. Options: tolerance, standard, sensor, refit_base, instrument, environment,
 * serial, measured. Needs the result's samples.csv to recognise samples that were used. Text:
 * certificate.html. [shared] */
KINCAL_API kincal_status kincal_verify(const kincal_result* result, const kincal_text* samples,
                                       const char* settings, kincal_answer** answer,
                                       kincal_error* error);
/* [one] */
KINCAL_API void kincal_answer_free(kincal_answer* answer);
/* Its JSON; buffers as of kincal_result_file(). [shared] */
KINCAL_API kincal_status kincal_answer_json(const kincal_answer* answer, char* buffer, size_t size,
                                            size_t* needed, kincal_error* error);

/* Another text of the answer, by its name; buffers as of kincal_result_file(). [shared] */
KINCAL_API kincal_status kincal_answer_file(const kincal_answer* answer, const char* name,
                                            char* buffer, size_t size, size_t* needed,
                                            kincal_error* error);
/* The residuals of kincal_evaluate(), as kincal_result_residuals(); KINCAL_INPUT of other answers.
 * [shared] */
KINCAL_API kincal_status kincal_answer_residuals(const kincal_answer* answer,
                                                 kincal_residual* buffer, size_t residual_size,
                                                 size_t count, size_t* needed, kincal_error* error);

/* ---------------------------------------------------------------------------- monitor
 * A monitor receives the samples of a calibrated robot one at a time and reports how well each
 * fits, and whether something has moved since the calibration (docs/on-a-robot.md). */
typedef struct kincal_monitor kincal_monitor;

typedef struct kincal_monitor_options {
  size_t size;
  double samples_between_alarms; /* mean number while nothing has moved; at least 10 */
} kincal_monitor_options;

/* One sensor's measurement of one target, in the rig's units. */
typedef struct kincal_view {
  int32_t sensor, target; /* indices of KINCAL_SENSORS and KINCAL_TARGETS */
  const int32_t* ids; /* of the target's points; none where the sensor measures poses, all 0 of a
                         plane */
  size_t ids_count;
  const double* z; /* the values of each point in its order (camera: u v; stereo, point, ...: as in
                      samples.jsonl); a pose: x y z qx qy qz qw; of a chain none */
  size_t z_count;
  const double* sigma; /* NULL: the rig's; else as many as the sensor has */
  size_t sigma_count;
} kincal_view;
typedef struct kincal_sample {
  size_t size;
  size_t view_size;       /* sizeof(kincal_view) */
  const char* id;         /* for messages; may be NULL */
  const double* readings; /* in the order of KINCAL_JOINTS; NaN: not in the sample */
  size_t readings_count;
  const kincal_view* views;
  size_t views_count;
} kincal_sample;

/* States of a sample. */
enum {
  KINCAL_FITS = 0,
  KINCAL_OUTLIER = 1,       /* left out unless the following ones do not fit either */
  KINCAL_TELLS_NOTHING = 2, /* no view has more measurements than its own unknowns */
  KINCAL_UNDEFINED = 3      /* it cannot be evaluated; see `why` */
};
typedef struct kincal_innovation {
  size_t size;
  int32_t state;
  int32_t alarm;       /* 1: something has moved; see kincal_monitor_moved() */
  int32_t unexplained; /* 1: consecutive outliers that no moved group explains */
  int32_t reserved;
  double chi2, dof;
  double probability; /* of the sensor with the worst fit */
  double log_odds;
  size_t sensors; /* number of sensors for kincal_monitor_sensor() */
  char why[256];
} kincal_innovation;

/* How many bytes a monitor of this result takes before its first sample, at most 5 % above: known
 * before one is made. [shared] */
KINCAL_API kincal_status kincal_monitor_memory(const kincal_result* result, size_t* bytes,
                                               kincal_error* error);
/* Starts from a result with a covariance. `options` may be NULL: 10000 samples. [shared] */
KINCAL_API kincal_status kincal_monitor_new(const kincal_result* result,
                                            const kincal_monitor_options* options,
                                            kincal_monitor** monitor, kincal_error* error);
/* [one] */
KINCAL_API void kincal_monitor_free(kincal_monitor* monitor);
/* As kincal_problem_name(), and KINCAL_GROUPS. [shared] */
KINCAL_API const char* kincal_monitor_name(const kincal_monitor* monitor, int32_t kind,
                                           size_t index);

/* Prepares for samples of this form (the same views of the same points), so that already the
 * first of them allocates nothing. This sample does not count. [one] */
KINCAL_API kincal_status kincal_monitor_prepare(kincal_monitor* monitor, const kincal_sample* like,
                                                kincal_error* error);
/* Adds a sample. Of a form that was there or prepared, most samples allocate nothing
 * (docs/on-a-robot.md#what-it-costs). Robots with floating joints, and sigmas of single readings,
 * need kincal_monitor_add_json(). [one] */
KINCAL_API kincal_status kincal_monitor_add(kincal_monitor* monitor, const kincal_sample* sample,
                                            kincal_innovation* innovation, kincal_error* error);
/* The same for one line of a samples.jsonl. [one] */
KINCAL_API kincal_status kincal_monitor_add_json(kincal_monitor* monitor, const kincal_text* sample,
                                                 kincal_innovation* innovation,
                                                 kincal_error* error);

/* The fit of one sensor, given the measurements of all others. */
typedef struct kincal_sensor_innovation {
  size_t size;
  size_t sensor;
  double chi2, dof, probability;
} kincal_sensor_innovation;
/* For the last sample added. [one] */
KINCAL_API kincal_status kincal_monitor_sensor(const kincal_monitor* monitor, size_t index,
                                               kincal_sensor_innovation* sensor,
                                               kincal_error* error);

/* A group that may have moved, and one of its components. */
typedef struct kincal_moved {
  size_t size;
  size_t group; /* of KINCAL_GROUPS */
  size_t changes;
  int64_t since; /* sample, counted from 0 */
  double probability;
} kincal_moved;
typedef struct kincal_change {
  size_t size;
  double change, sigma;
  char name[256];
  char unit[16];
} kincal_change;
/* Finds the groups that may have moved, the likeliest first, in some milliseconds: `count` groups,
 * with their probabilities if something has moved (call it after an alarm); none before the first
 * sample. They are kept until the next sample or restart. [one] */
KINCAL_API kincal_status kincal_monitor_find(kincal_monitor* monitor, size_t* count,
                                             kincal_error* error);
/* [one] */
KINCAL_API kincal_status kincal_monitor_moved(const kincal_monitor* monitor, size_t index,
                                              kincal_moved* moved, kincal_error* error);
/* [one] */
KINCAL_API kincal_status kincal_monitor_change(const kincal_monitor* monitor, size_t moved,
                                               size_t index, kincal_change* change,
                                               kincal_error* error);
/* Detects changes from now on. With `accept` (not 0) the likeliest change is applied to the monitor
 * first. [one] */
KINCAL_API kincal_status kincal_monitor_restart(kincal_monitor* monitor, int32_t accept,
                                                kincal_error* error);

/* An observed noise over the stated one. */
typedef struct kincal_noise {
  size_t size;
  int64_t sensor;  /* -1: the readings of a joint */
  char joint[256]; /* its name, else empty */
  char part[32];   /* of the sensor's noise, where it has several; else empty */
  double factor, residuals;
} kincal_noise;
/* By index; KINCAL_USAGE beyond the last one. [one] */
KINCAL_API kincal_status kincal_monitor_noise(const kincal_monitor* monitor, size_t index,
                                              kincal_noise* noise, kincal_error* error);

typedef struct kincal_counts {
  size_t size;
  int64_t samples, outliers; /* added, and the outliers among them */
  size_t noise;              /* kinds of observed noise */
} kincal_counts;
/* [one] */
KINCAL_API kincal_status kincal_monitor_counts(const kincal_monitor* monitor, kincal_counts* counts,
                                               kincal_error* error);

/* A window of samples, as structs or as lines of a samples.jsonl (the other is NULL), and the
 * groups that may have moved. */
typedef struct kincal_window {
  size_t size;
  const kincal_sample* samples;
  size_t sample_size; /* sizeof(kincal_sample) */
  size_t samples_count;
  const kincal_text* lines;
  kincal_names groups; /* of KINCAL_GROUPS */
  int32_t iterations;  /* 0: 5 */
  int32_t reserved;
} kincal_window;
typedef struct kincal_recalibration {
  size_t size;
  size_t samples;    /* that fit; the others were not used */
  size_t components; /* for kincal_monitor_recalibrated() */
} kincal_recalibration;
typedef struct kincal_recalibrated {
  size_t size;
  double value; /* a pose: the increment from the calibrated pose */
  double change, sigma;
  int32_t determined; /* 0: it may have moved, and the window does not determine it */
  int32_t reserved;
  char name[256];
  char unit[16];
} kincal_recalibrated;
/* Calibrates again from a window of samples, with the last calibration as prior for all but the
 * groups, in some milliseconds a sample. What the monitor has learned does not change. [one] */
KINCAL_API kincal_status kincal_monitor_recalibrate(kincal_monitor* monitor,
                                                    const kincal_window* window,
                                                    kincal_recalibration* recalibration,
                                                    kincal_error* error);
/* A component of the last recalibration, by index. [one] */
KINCAL_API kincal_status kincal_monitor_recalibrated(const kincal_monitor* monitor, size_t index,
                                                     kincal_recalibrated* recalibrated,
                                                     kincal_error* error);

/* Its state as bytes; buffers as of kincal_result_file(). [one] */
KINCAL_API kincal_status kincal_monitor_save(const kincal_monitor* monitor, char* buffer,
                                             size_t size, size_t* needed, kincal_error* error);
/* Continues from saved bytes. KINCAL_INPUT, without a change, if the bytes are damaged, of another
 * version, or of another calibration. [one] */
KINCAL_API kincal_status kincal_monitor_load(kincal_monitor* monitor, const char* bytes,
                                             size_t count, kincal_error* error);

/* ---------------------------------------------------------------------------- static view
 * A camera that should stand still and sees things that do not move, without a calibration
 * (docs/on-a-robot.md). */
typedef struct kincal_static_view kincal_static_view;

typedef struct kincal_static_options {
  size_t size;
  double samples_between_alarms; /* mean number while nothing moves; at least 10 */
  int32_t learning;              /* samples that define the reference positions; at least 3 */
  int32_t reserved;
} kincal_static_options;
typedef struct kincal_static_innovation {
  size_t size;
  int32_t learning; /* 1: still learning, not tested */
  int32_t alarm;    /* 1: something has moved; see kincal_static_view_moved() */
  double chi2, dof;
  double probability; /* of the point with the worst fit */
  double largest;     /* largest distance of a point from its reference, px */
  double log_odds;
  size_t left_out; /* points left out as outliers */
} kincal_static_innovation;
typedef struct kincal_static_moved {
  size_t size;
  int64_t point; /* -1: the camera */
  int64_t since; /* sample, counted from 0 */
  double probability;
  double shift[2], sigma[2]; /* px; for the camera at the centre of all points */
  double largest;            /* px, of any point */
} kincal_static_moved;

/* `points`: their number; an image need not have all. `options` may be NULL: 10000 and 10.
 * [any] */
KINCAL_API kincal_status kincal_static_view_new(size_t points, const kincal_static_options* options,
                                                kincal_static_view** view, kincal_error* error);
/* [one] */
KINCAL_API void kincal_static_view_free(kincal_static_view* view);
/* Adds an image: indices of `count` points, and u v of each. [one] */
KINCAL_API kincal_status kincal_static_view_add(kincal_static_view* view, const int32_t* points,
                                                const double* pixels, size_t count,
                                                kincal_static_innovation* innovation,
                                                kincal_error* error);
/* The points or camera that may have moved, by index, the likeliest first; KINCAL_USAGE beyond the
 * last one. [shared] */
KINCAL_API kincal_status kincal_static_view_moved(const kincal_static_view* view, size_t index,
                                                  kincal_static_moved* moved, kincal_error* error);
/* Learns the reference positions from the next images, starting with the last one. [one] */
KINCAL_API kincal_status kincal_static_view_restart(kincal_static_view* view, kincal_error* error);

#ifdef __cplusplus
}
#endif

#endif
