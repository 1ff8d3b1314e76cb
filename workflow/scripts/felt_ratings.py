"""The rated models as a hand would tell them, beside what people said, and what a survey would need."""

from job import run, stem

from lumbar.settings.perception import PerceptionSettings
from lumbar.settings.survey import SurveySettings
from lumbar.settings.tissue import TissueSettings


def main(
    input,
    output,
    settings: SurveySettings,
    tissue: TissueSettings,
    perception: PerceptionSettings,
    estimator: str,
    training: str,
    seed: int,
    data: str,
):
    """Read answers, models and the training record, write both tables."""
    from lumbar.interface.device import load_models
    from lumbar.interface.reading import read_listed
    from lumbar.records.ratings import read_ratings
    from lumbar.tissue.models.model_data import GIVEN
    from lumbar.tissue.perception.thresholds import Hands
    from lumbar.tissue.survey.felt_models import felt_pairs, survey_felt_table, survey_power_table

    ratings = read_ratings(input.ratings, settings.layout)
    label = ratings.label(data, settings.note)
    record = read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz)[training]
    known = {
        model.name: model
        for model in load_models(input.models, input.effects)
        if model.name in ratings.models
        and (model.estimator == GIVEN or (model.estimator == estimator and model.trained_on == training))
        and model.stable
    }
    felt = felt_pairs(known, record, tissue.settling_s, Hands.of(perception))
    survey_felt_table(ratings, felt, record.name, seed, label).write(stem(output.survey_felt))
    survey_power_table(ratings, seed, label).write(stem(output.survey_power))


run(main, snakemake)
