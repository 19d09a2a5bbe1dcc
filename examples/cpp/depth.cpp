// Depth of one image and its radar returns by an exported network, without Python: see docs/exports.md.
//
// Usage: depth NETWORK.pt IMAGE.ppm RETURNS.csv DEPTH.pfm [FOCAL_LENGTH_PX CAMERA_HEIGHT_M]

#include <torch/script.h>

#include <cmath>
#include <cstdint>
#include <exception>
#include <fstream>
#include <iostream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

constexpr int64_t kMultiple = 32;  // networks take heights and widths that are multiples of it
constexpr int64_t kColumns = 6;    // u_px, v_px, depth_m, rcs_dbsm, radial_speed_mps, age_s
constexpr int64_t kLargestSide = 16384;
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

int64_t padded(int64_t side) { return (side + kMultiple - 1) / kMultiple * kMultiple; }

/// Reads a binary PPM (P6) of 8 bits: (H, W, 3) uint8 RGB, at the network's focal length.
torch::Tensor read_image(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string magic;
  int64_t width = 0, height = 0, largest = 0;
  file >> magic >> width >> height >> largest;
  file.get();  // one blank ends the header
  if (!file || magic != "P6" || largest != 255 || width < 1 || height < 1 || width > kLargestSide ||
      height > kLargestSide) {
    throw std::runtime_error("expected a binary PPM of 8 bits without comments in " + path + "; convert the image");
  }
  auto image = torch::empty({height, width, 3}, torch::kUInt8);
  file.read(reinterpret_cast<char*>(image.data_ptr<uint8_t>()), image.numel());
  if (file.gcount() != image.numel()) {
    throw std::runtime_error("expected " + std::to_string(image.numel()) + " bytes of pixels in " + path + ", got " +
                             std::to_string(file.gcount()) + "; write the image again");
  }
  return image;
}

/// Reads returns, one a line: (N, 6) float32. Values that a radar does not give are empty; lines with # are comments.
torch::Tensor read_returns(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("no file of returns at " + path + "; give one, which may be empty");
  std::vector<float> values;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line.front() == '#') continue;
    std::istringstream cells(line + ",");
    int64_t count = 0;
    for (std::string cell; std::getline(cells, cell, ','); ++count) {
      values.push_back(cell.empty() ? kUnknown : std::stof(cell));
    }
    if (count != kColumns) {
      throw std::runtime_error("expected 6 values in the line '" + line + "' of " + path + ", got " +
                               std::to_string(count) + "; leave unknown ones empty");
    }
  }
  return torch::tensor(values).reshape({-1, kColumns});
}

/// Writes (H, W) float32 metres as PFM, whose rows go from the bottom to the top.
void write_depth(const std::string& path, const torch::Tensor& depth) {
  const auto rows = depth.flip(0).contiguous();
  std::ofstream file(path, std::ios::binary);
  file << "Pf\n" << depth.size(1) << " " << depth.size(0) << "\n-1.0\n";
  file.write(reinterpret_cast<const char*>(rows.data_ptr<float>()), rows.numel() * sizeof(float));
  if (!file.flush()) throw std::runtime_error("cannot write " + path + "; check the folder and its free space");
}

void estimate(const std::vector<std::string>& given) {
  torch::InferenceMode no_gradients;
  auto network = torch::jit::load(given[0]);
  network.eval();
  const auto image = read_image(given[1]);
  const auto radar = read_returns(given[2]);
  const int64_t height = image.size(0), width = image.size(1);

  // A level road below the camera: its inverse depth is b v + c. Without it the network is told that it is unknown.
  auto ground = torch::full({1, 4}, kUnknown);
  if (given.size() == 6) {
    const float slope = 1.0f / (std::stof(given[4]) * std::stof(given[5]));
    ground = torch::tensor({0.0f, slope, -slope * 0.5f * static_cast<float>(height - 1), 1.0f}).reshape({1, 4});
  }

  auto pixels = torch::zeros({1, 3, padded(height), padded(width)});
  pixels.slice(2, 0, height).slice(3, 0, width).copy_(image.permute({2, 0, 1}).unsqueeze(0).to(torch::kFloat32) / 255.0);
  const auto valid = torch::ones({1, radar.size(0)}, torch::kBool);
  const auto depths = network.forward({pixels, radar.unsqueeze(0), valid, ground}).toTuple()->elements();
  const auto dense = depths[0].toTensor()[0][0].slice(0, 0, height).slice(1, 0, width);
  write_depth(given[3], dense);
  std::cout << "depth from " << dense.min().item<float>() << " to " << dense.max().item<float>() << " m\n";
}

}  // namespace

int main(int count, char** arguments) {
  const std::vector<std::string> given(arguments + 1, arguments + count);
  if (given.size() != 4 && given.size() != 6) {
    std::cerr << "usage: depth NETWORK.pt IMAGE.ppm RETURNS.csv DEPTH.pfm [FOCAL_LENGTH_PX CAMERA_HEIGHT_M]\n";
    return 2;
  }
  try {
    estimate(given);
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
  return 0;
}
