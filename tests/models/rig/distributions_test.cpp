// models/rig/distributions: exact tails and quantiles.
//
// Proves: tails and their logarithms agree to 12 digits with values computed to 40 digits
// (mpmath), near the mean, far out (1e-100) and beyond what a double holds; quantiles and deviates
// invert them. Does not prove: more than 10 digits at 10,000 degrees of freedom, and anything
// beyond.
#include "../../../models/rig/distributions.h"

#include <catch2/catch.hpp>
#include <vector>

namespace distributions_test {

using namespace kincal;

namespace {

constexpr double kDigits = 1e-12;
constexpr double kTenPercentOf7 = 2.83310691781534;

struct TailCase {
  double at, freedom1, freedom2, log_tail;
};

Approx nearly(double x) { return Approx(x).epsilon(kDigits).margin(1e-300); }

}  // namespace

TEST_CASE("distributions: tails of chi-squared") {
  const std::vector<TailCase> cases = {
      {1, 1, 0, -1.14787446444932},       {3.5, 2, 0, -1.75},
      {10, 4, 0, -3.20824053077194},      {60, 24, 0, -9.65855080114823},
      {200, 72, 0, -30.5323274225831},    {5, 10, 0, -0.11521107470693},
      {480, 4, 0, -234.515203066509},     {600, 20, 0, -261.437431531342},
      {900, 400, 0, -91.6127161317127},   {41, 2, 0, -20.5},
      {1050, 1000, 0, -2.02136845030047}, {2000, 2, 0, -1000},
      {3000, 30, 0, -1422.79676493306},   {1e5, 100, 0, -49614.3956275494}};
  for (const TailCase& c : cases) {
    CAPTURE(c.at, c.freedom1);
    CHECK(log_chi2_tail(c.at, c.freedom1) == nearly(c.log_tail));
  }
  CHECK(log_chi2_tail(10200, 10000) == Approx(-2.53415301642396).epsilon(1e-10));
  CHECK(chi2_tail(480, 4) == nearly(1.41690713027711e-102));
  CHECK(chi2_tail(0, 3) == 1);
}

TEST_CASE("distributions: tails of F") {
  const std::vector<TailCase> cases = {
      {2, 3, 10, -1.72593011508863},       {0.5, 4, 7, -0.304236354079609},
      {5, 6, 40, -7.31814297741141},       {1.2, 30, 2000, -1.55867546706906},
      {60, 5, 30, -32.2048751508522},      {400, 6, 60, -105.24835843764},
      {0.1, 1, 5, -0.268396210304351},     {1e4, 3, 200, -499.304168073826},
      {2.5, 200, 5000, -57.7669660782125}, {1e6, 2, 500, -2073.57490221431}};
  for (const TailCase& c : cases) {
    CAPTURE(c.at, c.freedom1, c.freedom2);
    CHECK(log_f_tail(c.at, c.freedom1, c.freedom2) == nearly(c.log_tail));
  }
  CHECK(f_tail(1e4, 3, 200) == nearly(1.42874595629333e-217));
}

TEST_CASE("distributions: tails of Student's t") {
  const std::vector<TailCase> cases = {{2.228138851964939, 10, 0, -3.68887945407776},
                                       {-2.228138851964939, 10, 0, -0.0253178079852174},
                                       {0.5, 3, 0, -1.12170493593187},
                                       {4.1437, 10, 0, -6.90775449135045},
                                       {50, 2, 0, -8.51779297152817},
                                       {40, 60, 0, -102.559323836312},
                                       {30, 400, 0, -239.463535246199},
                                       {1e3, 300, 0, -1220.57571986575},
                                       {1e3, 2, 0, -14.5086592385228},
                                       {3, 2.5, 0, -3.31626685434013}};
  for (const TailCase& c : cases) {
    CAPTURE(c.at, c.freedom1);
    CHECK(log_student_tail(c.at, c.freedom1) == nearly(c.log_tail));
  }
  CHECK(student_tail(30, 400) == nearly(1.00532857178899e-104));
}

TEST_CASE("distributions: tails of the normal distribution") {
  const std::vector<TailCase> cases = {
      {0, 0, 0, -0.693147180559945},    {1.959963984540054, 0, 0, -3.68887945411394},
      {-1, 0, 0, -0.17275377902345},    {6, 0, 0, -20.7367689499747},
      {21.27, 0, 0, -230.184884449419}, {37, 0, 0, -689.030585576891},
      {50, 0, 0, -1254.83136113942},    {200, 0, 0, -20006.2172808982},
      {-8, 0, 0, -6.22096057427179e-16}};
  for (const TailCase& c : cases) {
    CAPTURE(c.at);
    CHECK(log_normal_tail(c.at) == nearly(c.log_tail));
  }
  CHECK(normal_tail(21.27) == nearly(1.07640291717132e-100));
}

TEST_CASE("distributions: quantiles") {
  const std::vector<std::pair<double, double>> student = {
      {2, 4.30265272974946},   {3, 3.18244630528371},  {5, 2.57058183563632},
      {9, 2.26215716279821},   {30, 2.04227245630124}, {100, 1.98397151852355},
      {1000, 1.96233908082641}};
  for (const auto& [freedom, quantile] : student)
    CHECK(student_quantile(0.025, freedom) == nearly(quantile));
  const std::vector<std::pair<double, double>> six_sigmas = {
      {1, 37.3512275047787}, {2, 41.4735378999494},  {3, 44.8688710220666},
      {6, 53.3736797128768}, {40, 118.721767139411}, {400, 593.673845449698}};
  for (const auto& [freedom, quantile] : six_sigmas)
    CHECK(chi2_quantile(9.86587645037698e-10, freedom) == nearly(quantile));
  CHECK(chi2_quantile(0.9, 1) == nearly(0.0157907740934312));
  CHECK(chi2_quantile(0.9, 7) == nearly(kTenPercentOf7));
  CHECK(chi2_quantile(0.9, 57) == nearly(43.8161480963559));
}

TEST_CASE("distributions: values as those of a standard normal variable") {
  CHECK(chi2_deviate(53.3736797128768, 6) == nearly(6));
  CHECK(chi2_deviate(kTenPercentOf7, 7) == nearly(-1.2815515655446004));
  CHECK(log_normal_tail(chi2_deviate(1e5, 100)) == nearly(-49614.3956275494));
  CHECK(std::isfinite(chi2_deviate(0, 5)));
  CHECK(log_normal_tail(f_deviate(1e6, 2, 500)) == nearly(-2073.57490221431));
  CHECK(f_deviate(0.4, 8, 30) == nearly(-f_deviate(2.5, 30, 8)));
  CHECK(log_normal_tail(student_deviate(30, 400)) == nearly(-239.463535246199));
  CHECK(student_deviate(-2.228138851964939, 10) == nearly(-student_deviate(2.228138851964939, 10)));
  CHECK(std::abs(student_deviate(0, 4)) < kDigits);
}

}  // namespace distributions_test
