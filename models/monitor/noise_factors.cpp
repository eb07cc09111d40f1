#include "noise_factors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "../rig/distributions.h"
#include "state_bytes.h"

namespace kincal {
namespace {

constexpr double kLeastVariance = 1e-3;  // over the stated one: data without noise prove nothing

double scatter_variance(size_t i) { return std::ldexp(0.5, -static_cast<int>(i)); }  // 2 / nu

double tail(double chi2, double dof, double nu, double known) {
  return f_tail(chi2 / dof, dof, 1 / (1 / nu + 1 / known));
}

}  // namespace

NoiseScatter::NoiseScatter() { find_nu(); }

void NoiseScatter::find_nu() {
  double sum = 0, mean = 0;
  for (size_t i = 0; i < log_odds_.size(); ++i) {
    const double odds = std::exp(log_odds_[i]);
    sum += odds;
    mean += odds * scatter_variance(i);
  }
  nu_ = 2 * sum / mean;
}

void NoiseScatter::add(double chi2, double dof, double known) {
  if (!(chi2 > 0) || !(dof > 0)) return;
  // The logarithm of chi2 / dof less its mean, and its variance: digamma and trigamma of dof / 2.
  const double off = std::log(chi2 / dof) + (1 + 1 / (3 * dof)) / dof,
               variance = (2 + (2 + 4 / (3 * dof)) / dof) / dof + 2 / known;
  double most = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < log_odds_.size(); ++i) {
    const double all = variance + scatter_variance(i);
    log_odds_[i] -= 0.5 * (std::log(all) + off * off / all);
    most = std::max(most, log_odds_[i]);
  }
  for (double& log : log_odds_) log -= most;
  find_nu();
}

void NoiseScatter::transfer(StateBytes& bytes) {
  for (double& log : log_odds_) bytes.value(log);
  find_nu();
}

double NoiseFactors::Factor::variance() const {
  return std::max(kLeastVariance, (kNoiseKnown + squares) / known());
}

NoiseFactors::NoiseFactors(const Rig& rig) {
  for (size_t j = 0; j < rig.tree.joints.size(); ++j) kinds_.push_back({-1, static_cast<int>(j)});
  for (size_t k = 0; k < rig.sensors.size(); ++k) {
    first_.push_back(static_cast<int>(kinds_.size()));
    const size_t parts = std::max<size_t>(1, rig.sensors[k].model->noise_parts().size());
    for (size_t part = 0; part < parts; ++part)
      kinds_.push_back({static_cast<int>(k), static_cast<int>(part)});
  }
  first_.push_back(static_cast<int>(kinds_.size()));
  factors_.resize(kinds_.size());
  own_.assign(kinds_.size(), 1);
  scatter_.resize(rig.sensors.size());
  own_factor_.assign(scatter_.size(), 1);
}

void NoiseFactors::find_own(const Equations& e) {
  for (size_t k = 0; k < kinds_.size(); ++k) own_[k] = factors_[k].variance();
  for (size_t s = 0; s < scatter_.size(); ++s) {
    double chi2 = 0, dof = 0;
    for (int k = first_[s]; k < first_[s + 1]; ++k) {
      chi2 += e.rest[k].first / own_[k];
      dof += e.rest[k].second;
    }
    set_own(static_cast<int>(s), chi2, dof);
  }
}

void NoiseFactors::find_own(const Innovation& judged) {
  for (size_t k = 0; k < kinds_.size(); ++k) own_[k] = factors_[k].variance();
  for (const SensorInnovation& s : judged.sensors) set_own(s.sensor, s.chi2, s.dof);
}

void NoiseFactors::set_own(int sensor, double chi2, double dof) {
  const double nu = scatter_[sensor].nu();
  own_factor_[sensor] = (nu + chi2) / (nu + dof);
  for (int k = first_[sensor]; k < first_[sensor + 1]; ++k) own_[k] *= own_factor_[sensor];
}

/// Returns how often the noise alone of a sensor's part is larger by chance.
double NoiseFactors::tail_alone(const Equations& e, int sensor, int kind) const {
  const auto& [squares, residuals] = e.rest[kind];
  return tail(squares / factors_[kind].variance(), residuals, scatter_[sensor].nu(),
              factors_[kind].known());
}

double NoiseFactors::misfit(const Equations& e) const {
  double out = 0;
  for (size_t s = 0; s < scatter_.size(); ++s)
    for (int k = first_[s]; k < first_[s + 1]; ++k)
      if (e.rest[k].second > 0 && tail_alone(e, static_cast<int>(s), k) < kOutlier)
        out = std::max(out, e.rest[k].first / e.rest[k].second / factors_[k].variance());
  return out;
}

/// Returns how many residuals determined the noise that a sensor shows.
double NoiseFactors::known_of(int sensor, const Innovations& innovations) const {
  double known = std::numeric_limits<double>::infinity();
  for (int k = first_[sensor]; k < first_[sensor + 1]; ++k)
    if (innovations.noise()[k].seen) known = std::min(known, factors_[k].known());
  return known;
}

/// Judges a sensor by the noise alone, and by what parameters change; `parts` becomes the number of
/// tests. The probability is the least of theirs.
SensorInnovation NoiseFactors::judge(const Innovations::OfSensor& rows, const Equations& e,
                                     double known, int& parts) const {
  const int s = rows.sensor;
  SensorInnovation out{s, rows.chi2 * own_factor_[s], rows.dof, 1};
  double alone = 0;
  parts = 1;
  for (int k = first_[s]; k < first_[s + 1]; ++k) {
    const double residuals = e.rest[k].second;
    if (!(residuals > 0)) continue;
    out.probability = std::min(out.probability, tail_alone(e, s, k));
    out.chi2 += e.rest[k].first / factors_[k].variance();
    out.dof += residuals;
    alone += residuals;
    ++parts;
  }
  if (rows.dof > 0)
    out.probability =
        std::min(out.probability, tail(rows.chi2, rows.dof, scatter_[s].nu() + alone, known));
  return out;
}

void NoiseFactors::judge(const Equations& e, const Innovations& innovations,
                         Innovation& out) const {
  out.chi2 = innovations.chi2();
  out.dof = innovations.dof();
  for (size_t k = 0; k < kinds_.size(); ++k) {
    out.chi2 += e.rest[k].first / factors_[k].variance();
    out.dof += e.rest[k].second;
  }
  double least = 1;
  int tried = 0;
  for (const Innovations::OfSensor& rows : innovations.sensors()) {
    int parts = 0;
    SensorInnovation sensor = judge(rows, e, known_of(rows.sensor, innovations), parts);
    least = std::min(least, sensor.probability);
    tried += parts;
    sensor.probability = std::min(1.0, parts * sensor.probability);
    out.sensors.push_back(sensor);
  }
  out.probability = std::min(1.0, tried * least);
}

void NoiseFactors::learn(const Innovations& innovations, const Innovation& judged) {
  for (const SensorInnovation& s : judged.sensors)
    scatter_[s.sensor].add(s.chi2, s.dof, known_of(s.sensor, innovations));
  for (size_t k = 0; k < kinds_.size(); ++k) {
    factors_[k].squares += innovations.noise()[k].squares;
    factors_[k].residuals += innovations.noise()[k].residuals;
  }
}

std::vector<NoiseSeen> NoiseFactors::seen() const {
  std::vector<NoiseSeen> out;
  for (size_t k = 0; k < kinds_.size(); ++k) {
    const Factor& factor = factors_[k];
    if (factor.residuals > 0)
      out.push_back(
          {kinds_[k].first, kinds_[k].second, std::sqrt(factor.variance()), factor.residuals});
  }
  return out;
}

void NoiseFactors::transfer(StateBytes& bytes) {
  std::vector<size_t> seen;
  for (size_t k = 0; bytes.writes() && k < kinds_.size(); ++k)
    if (factors_[k].residuals > 0) seen.push_back(k);
  if (!bytes.writes()) std::fill(factors_.begin(), factors_.end(), Factor());
  bytes.list(seen, [&](size_t& k) {
    std::pair<int, int> of = bytes.writes() ? kinds_[k] : std::pair<int, int>();
    bytes.value(of.first);
    bytes.value(of.second);
    k = static_cast<size_t>(std::find(kinds_.begin(), kinds_.end(), of) - kinds_.begin());
    if (k == kinds_.size()) throw std::invalid_argument("state: it is damaged");
    bytes.value(factors_[k].squares);
    bytes.value(factors_[k].residuals);
  });
  for (NoiseScatter& s : scatter_) s.transfer(bytes);
}

}  // namespace kincal
