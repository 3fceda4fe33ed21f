"""CaMoJAB beside other models, without parts of itself, and before an audience."""

from ._ablation import ablation as ablation
from ._measurements import measurements as measurements
from ._preferences import validation_preferences as validation_preferences
from ._table import compare as compare, table5 as table5
from ._validation import predicted_scores as predicted_scores, validate as validate
