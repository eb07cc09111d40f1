// Saddle points of a picture: corners where two dark and two bright fields of a print meet.
//
// Every edge that meets in a corner q runs towards it: the gradient g at a pixel p of an edge is at
// right angles to p - q. q makes sum w (g' (p - q))^2 least, as that of cv::cornerSubPix does, with
// three differences. The picture is smoothed first, which takes away most of what sampling does to
// gradients, and noise. Pixels stay where they are and nothing is interpolated; the weights move
// instead. And the weights are a cross along the edges in the plane of the print, as far as the
// print is plain there: seen obliquely, or beside markers, a square of pixels would reach into what
// is next or be too small. Light that changes across the picture has gradients of its own: its
// share is taken out of the window first.
//
// Sigma. q solves F = sum w g g' (p - q) = 0. To first order the noise n of the pixels moves it by
// J^-1 C n, where J = dF/dq and C collects what each pixel does to the gradients around it (the
// filters, transposed); its covariance is noise^2 J^-1 C C' J^-T. Of a compressed picture C's rows
// are transformed as its blocks of pixels were, and each coefficient has a variance of its own:
// noise^2 + step^2 / 12 (compression.h). Beside that stays what is not
// noise: a few thousandths of a pixel of sampling, and what is printed beside the strip along the
// edges, if that is thin for the blur: b, the sigma of an edge with all that smooths it, makes
// markers beside a strip of width s move a corner by 0.08 b exp(-1.5 s / b) (measured on rendered
// boards, squares of 13 to 46 px, blur 0.5 to 1.2).
#pragma once

#include "compression.h"
#include "image_target.h"

namespace kincal {

/// A Saddle is such a corner, first as guessed, then as the picture has it.
struct Saddle {
  int id = 0;  // of the target's points
  cv::Point2d pixel;
  cv::Matx22d sides;            // px of one unit of the print, as columns along the two edges
  double reach = 0, strip = 0;  // units that are plain: along an edge, and beside it
  bool squares = false;         // the fields around it are plain squares, and go on as such
  cv::Vec2d light;              // the share by which the light grows, of a pixel along x and y
  double sigma = 0;             // px of a coordinate, by the noise of the pixels
  double miss = 0;              // px, rms: how far from the corner its edges run
};

/// A PixelNoise is how wrong pixels are: grey levels from pixel to pixel, and what was compressed.
struct PixelNoise {
  double sigma = 1;
  Compression compression;
};

/// Moves a corner to where the picture has it. Returns false, and changes nothing, where there is
/// none, or it runs away. `noise`: and says how well it is known, which takes as long again.
bool refine(const cv::Mat& image, Saddle& saddle, const PixelNoise* noise);

/// Refines the corners of a target, in the order of their ids, and says how well they are known,
/// by every few of them.
/// Left out are those that cannot be located: no saddle, or the strip is too thin for the blur, or
/// beside markers the fields around it are not dark and bright in turn (Detection::no_corners).
Detection refined(const cv::Mat& image, const Compression& compression,
                  std::vector<Saddle> saddles);

}  // namespace kincal
