// Region growing of the Point Cloud Library on raw float32 coordinates; writes an int32 for each point.
// pcl_growing POINTS LABELS NORMAL_NEIGHBORS NEIGHBORS DEGREES CURVATURE MIN_SIZE
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <vector>

#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/region_growing.h>

int main(int, char **argv) {
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  std::ifstream points(argv[1], std::ios::binary);
  for (float p[3]; points.read(reinterpret_cast<char *>(p), sizeof p);)
    cloud->push_back(pcl::PointXYZ(p[0], p[1], p[2]));

  pcl::search::Search<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
  pcl::PointCloud<pcl::Normal>::Ptr normals(new pcl::PointCloud<pcl::Normal>);
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setSearchMethod(tree);
  estimation.setInputCloud(cloud);
  estimation.setKSearch(std::atoi(argv[3]));
  estimation.compute(*normals);

  pcl::RegionGrowing<pcl::PointXYZ, pcl::Normal> growing;
  growing.setSearchMethod(tree);
  growing.setInputCloud(cloud);
  growing.setInputNormals(normals);
  growing.setNumberOfNeighbours(std::atoi(argv[4]));
  growing.setSmoothnessThreshold(std::atof(argv[5]) * M_PI / 180);
  growing.setCurvatureThreshold(std::atof(argv[6]));
  growing.setMinClusterSize(std::atoi(argv[7]));
  std::vector<pcl::PointIndices> regions;
  growing.extract(regions);

  std::vector<std::int32_t> labels(cloud->size(), -1);
  for (std::size_t i = 0; i < regions.size(); ++i)
    for (int row : regions[i].indices) labels[row] = static_cast<std::int32_t>(i);
  std::ofstream(argv[2], std::ios::binary)
      .write(reinterpret_cast<const char *>(labels.data()), labels.size() * sizeof labels[0]);
}
