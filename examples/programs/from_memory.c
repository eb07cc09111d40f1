/* From files in memory to a robot that is watched: see docs/c.md. */
#include <kincal.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static kincal_error error = KINCAL_ERROR_INIT;

static void must(kincal_status status) {
  if (status == KINCAL_OK) return;
  printf("%s\n", error.message); /* error.file, .line and .name say where */
  exit(1);
}

/* A file as a text; yours may come from anywhere. */
static kincal_text text_of(const char* name) {
  FILE* in = fopen(name, "rb");
  if (!in) exit(1);
  fseek(in, 0, SEEK_END);
  kincal_text text = {NULL, (size_t)ftell(in), name};
  rewind(in);
  char* data = malloc(text.size);
  if (!data || fread(data, 1, text.size, in) != text.size) exit(1);
  fclose(in);
  text.data = data;
  return text;
}

int main(void) {
  const kincal_text rig = text_of("rig.yaml"), urdf = text_of("robot.urdf"), samples = text_of("samples.jsonl");
  kincal_problem* problem = NULL;
  must(kincal_problem_new(&rig, &urdf, &samples, &problem, &error));
  kincal_result* result = NULL;
  must(kincal_calibrate(problem, "{\"noise\": \"latent\"}", NULL, &result, &error));
  kincal_problem_free(problem);

  kincal_summary summary;
  summary.size = sizeof summary;
  must(kincal_result_summary(result, &summary, &error));
  printf("%s: %s, chi2/dof %.3f\n", summary.use, summary.status, summary.chi2 / (double)summary.dof);
  for (size_t i = 0; i < summary.components; ++i) {
    kincal_component c;
    c.size = sizeof c;
    must(kincal_result_component(result, i, &c, &error));
    if (strstr(c.name, "elbow_flex_joint/offset")) printf("%s %.4f +- %.4f %s\n", c.name, c.value, c.sigma, c.unit);
  }

  /* Where the hand is, with all joints at 0.1. */
  double readings[64], pose[16];
  size_t joints = 0;
  while (kincal_result_name(result, KINCAL_JOINTS, joints)) readings[joints++] = 0.1;
  must(kincal_result_forward(result, readings, joints, "l_wrist_roll_link", NULL, pose, &error));
  printf("hand at %.4f %.4f %.4f m\n", pose[3], pose[7], pose[11]);

  /* What is to be kept of it: any file of its folder. Later these texts are the result again. */
  const char* const names[] = {"rig.yaml", "robot.urdf", "result.json", "covariance.csv"};
  kincal_text files[4];
  for (int i = 0; i < 4; ++i) {
    size_t needed = 0;
    must(kincal_result_file(result, names[i], NULL, 0, &needed, &error));
    char* buffer = malloc(needed);
    must(kincal_result_file(result, names[i], buffer, needed, NULL, &error));
    const kincal_text file = {buffer, needed - 1, names[i]};
    files[i] = file;
  }
  kincal_result_free(result);
  must(kincal_result_read(files, 4, &result, &error));

  /* Watched: here the samples from above, a line each. */
  kincal_monitor* monitor = NULL;
  must(kincal_monitor_new(result, NULL, &monitor, &error));
  const char* line = samples.data;
  while (line < samples.data + samples.size) {
    const char* end = memchr(line, '\n', (size_t)(samples.data + samples.size - line));
    const kincal_text one = {line, (size_t)(end - line), "sample"};
    kincal_innovation innovation;
    innovation.size = sizeof innovation;
    must(kincal_monitor_add_json(monitor, &one, &innovation, &error));
    if (innovation.alarm) printf("something has moved\n"); /* kincal_monitor_find() says what */
    line = end + 1;
  }
  kincal_counts counts;
  counts.size = sizeof counts;
  must(kincal_monitor_counts(monitor, &counts, &error));
  printf("%d samples, %d outliers\n", (int)counts.samples, (int)counts.outliers);

  /* What is wrong is said, and nothing has changed. */
  for (size_t i = 0; i < joints; ++i) readings[i] = NAN;
  if (kincal_result_forward(result, readings, joints, "l_wrist_roll_lnk", NULL, pose, &error) == KINCAL_INPUT) printf("%s\n", error.message);
  kincal_monitor_free(monitor);
  kincal_result_free(result);
  return 0;
}
