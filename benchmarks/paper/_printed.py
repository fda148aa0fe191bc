"""Numbers that the first paper prints in Tables 1 and 4.

They are shown beside the reproduced numbers, with their misprints.
"""


def rows_of(text):
    """The numbers of each line, by its first two words."""
    by_words = {}
    for line in text.strip().splitlines():
        name, key, *numbers = line.split()
        row = by_words.setdefault(name, {})
        row[int(key) if key.isdigit() else key] = tuple(map(float, numbers))
    return by_words


OUTLIERS = ("clustered", "uniform")
STATISTICS = ("mean", "min", "max", "median", "StD", "QR")

# Table 1, bias angles in degrees: method, distribution of the outliers, STATISTICS.
ANGLES = rows_of("""
PCA      clustered  34.483  3.807  52.690  34.255   3.973   4.758
PCA      uniform    27.593  0.442  89.819  25.339  16.231  19.237
RANSAC   clustered   1.188  0.000   6.367   0.832   1.167   1.618
RANSAC   uniform     1.184  0.005   9.140   0.824   1.204   1.574
MSAC     clustered   1.140  0.000   7.378   0.687   1.215   1.605
MSAC     uniform     1.157  0.000   7.379   0.730   1.202   1.569
RPCA     clustered   0.694  0.022   2.698   0.599   0.489   0.550
RPCA     uniform     0.675  0.025   3.326   0.550   0.504   0.547
uLSIF    clustered   6.097  0.562  17.938   5.731   2.304   2.769
uLSIF    uniform     2.550  0.056  12.277   2.116   1.874   2.146
qSp      clustered  24.144  0.017  43.968  30.262  15.302  30.168
qSp      uniform     4.611  0.034  18.722   3.603   3.775   4.666
MCMD_Z   clustered   0.389  0.007   1.896   0.328   0.268   0.295
MCMD_Z   uniform     0.427  0.016   1.905   0.366   0.286   0.353
MCMD_MD  clustered   0.514  0.005   2.119   0.450   0.319   0.402
MCMD_MD  uniform     0.522  0.012   2.244   0.452   0.335   0.420
""")

# Table 4, percent, 100 points: method, percentage of outliers, RATES.
SHARES = (5, 20, 40)
RATES = ("TPR", "TNR", "FPR", "FNR", "accuracy")
CLASSIFICATION = rows_of("""
RANSAC   5   100.0   33.0  67.0   0.0   36.35
RANSAC   20  100.0   33.8  66.2   0.0   47.06
RANSAC   40  100.0   35.7  64.3   0.0   61.44
RPCA     5   100.0   94.3   5.7   0.0   94.62
RPCA     20  100.0   96.3   3.7   0.0   97.05
RPCA     40  100.0   98.3   1.7   0.0   98.97
uLSIF    5    76.8   96.6   3.3  23.2   95.68
uLSIF    20   93.9   94.7   5.3   6.2   94.54
uLSIF    40   96.9   87.9  12.1   3.1   91.50
qSp      5    71.8   95.3   4.6  28.2   94.18
qSp      20   48.9   74.7  25.3  51.2   69.54
qSp      40   36.8   57.9  42.2  63.2   49.43
MCMD_Z   5   100.0   98.0   1.9   0.0   98.14
MCMD_Z   20  100.0   99.7   0.4   0.0   99.72
MCMD_Z   40  100.0  100.0   0.0   0.0  100.00
MCMD_MD  5   100.0   97.8   2.1   0.0   97.94
MCMD_MD  20  100.0   97.8   2.3   0.0   98.20
MCMD_MD  40  100.0   98.3   1.7   0.0   98.97
""")
