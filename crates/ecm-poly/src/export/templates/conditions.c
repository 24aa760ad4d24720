const inputs_t @NAME@_default_conditions = {R(@REFERENCE@), R(0)};
const inputs_t @NAME@_least_conditions = {@LEASTINPUTS@};
const inputs_t @NAME@_largest_conditions = {@LARGESTINPUTS@};

int32_t @NAME@_inputs_inside(const inputs_t *inputs)
{
    const inputs_t *low = &@NAME@_least_conditions, *high = &@NAME@_largest_conditions;
    return (int32_t)((low->temperature_degC <= inputs->temperature_degC) &
                     (inputs->temperature_degC <= high->temperature_degC) &
                     (low->age_s <= inputs->age_s) & (inputs->age_s <= high->age_s));
}

/* Factor of the wrench by temperature and age */
static real size_at(const inputs_t *inputs)
{
    real lost, left;
    decay(inputs->age_s * settling_per_s, &lost, &left);
    return R(1) - softer_per_kelvin * (inputs->temperature_degC - R(@REFERENCE@)) +
           ageing_per_s * inputs->age_s * left;
}
